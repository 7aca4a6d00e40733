"""A person who reaches about with both arms, may sway or march on the spot, and doesn't look at the worn arm."""

from __future__ import annotations

from math import pi, radians, sin
from typing import Final

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, exp, from_euler_xyz, product
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.tree import Tree
from srl.sim.wearer.motion import quintic
from srl.studies.human_srl.wearers import Wearer

AVERAGE: Final = Wearer("W00", 1.0, 0.8, 0.8, 0.8, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""As the paper's figure, thinner than the envelope, upright."""
_HANG: Final = (0.2, 1.3, 0.3)  # rad, of an arm at ease: forward, down, elbow
_LOW, _HIGH = (-0.2, 0.2, 0.0), (1.4, 1.3, 1.9)  # rad, of the postures in front of the body
_AT_ONCE, _A_RADIAN = 0.7, 0.6  # s of a reach, and s more a radian of the joint that goes farthest
_SIDES: Final = (("Right", 1.0), ("Left", -1.0))
_VERTEBRAE: Final = ("Spine1", "Spine2", "Spine3")
_SWAY: Final = (0.5, 0.35, 0.65)  # Hz, of the trunk about x, y, z: ours
_STEPS: Final = 0.8  # Hz, of each leg: ours


class Reaching:
    """Both arms go from one random posture in front of the body to the next, by minimum jerk.

    Attributes:
        names: (59) joints of the suit.
        translation: (59, 3) m, of the joints in their parents.
    """

    def __init__(
        self, body: Tree, rng: np.random.Generator, who: Wearer = AVERAGE, sway: float = 0.0, march: float = 0.0
    ) -> None:
        """
        Args:
            body: the person's skeleton, in the person's size.
            rng: of the motion.
            who: pace and posture.
            sway: rad, by which the trunk above the waist goes to and fro about each axis.
            march: rad, by which one thigh after the other is lifted, the shank hanging.
        """
        joints = list(body.joints)
        self.names = tuple(body.names[i] for i in joints)
        self.translation: Array = body.offsets[joints].copy()
        self._rng, self._pace = rng, who.pace
        posture = np.array(_HANG)
        self._moves = {side: (0.0, 1e-6, posture, posture) for side, _ in _SIDES}
        self._stance = self._standing(who)
        self._sway, self._march = sway, march

    def rotation(self, t: float) -> Array:
        """(59, 4) quaternions at t s; t must not fall."""
        made = self._stance.copy()
        if self._sway:
            for joint in _VERTEBRAE:
                self._add(made, joint, exp(*(self._sway / len(_VERTEBRAE) * sin(2.0 * pi * hz * t) for hz in _SWAY)))
        for side, sign in _SIDES:
            if self._march and (lift := self._march * max(0.0, sign * sin(2.0 * pi * _STEPS * t)) ** 2):
                self._add(made, f"{side}UpLeg", exp(-lift, 0.0, 0.0))
                self._add(made, f"{side}Leg", exp(lift, 0.0, 0.0))
            begin, lasts, start, end = self._moves[side]
            if t >= begin + lasts:
                goal = self._rng.uniform(_LOW, _HIGH)
                lasts = (_AT_ONCE + np.abs(goal - end).max() * _A_RADIAN) / self._pace
                begin, start, end = t, end, goal
                self._moves[side] = begin, lasts, start, end
            a, b, c = start + (end - start) * quintic(min((t - begin) / lasts, 1.0))
            upper = product(from_euler_xyz(0.0, sign * a, 0.0), from_euler_xyz(0.0, 0.0, sign * b))
            self._turn(made, f"{side}Arm", upper)
            self._turn(made, f"{side}ForeArm", from_euler_xyz(0.0, sign * c, 0.0))
        return made

    def aside(self) -> Array:
        """(59, 4): both arms stretched out sideways."""
        return self._stance.copy()

    def _standing(self, who: Wearer) -> Array:
        made = np.tile([1.0, 0.0, 0.0, 0.0], (len(self.names), 1))
        share = [radians(angle) / len(_VERTEBRAE) for angle in (who.lean, who.twist, who.bend)]  # about x, y, z
        for joint in _VERTEBRAE:
            self._turn(made, joint, from_euler_xyz(*share))
        for side, sign in _SIDES:
            thigh = from_euler_xyz(sign * radians(who.stride), 0.0, -sign * radians(who.apart))
            self._turn(made, f"{side}UpLeg", thigh)
        return made

    def _turn(self, made: Array, joint: str, q: Quaternion) -> None:
        made[self.names.index(joint)] = q

    def _add(self, made: Array, joint: str, q: Quaternion) -> None:
        w, x, y, z = made[self.names.index(joint)].tolist()
        self._turn(made, joint, product((w, x, y, z), q))
