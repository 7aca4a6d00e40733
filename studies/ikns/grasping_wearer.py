"""How a simulated wearer grasps: with the own null-space motion, or with a ring on the other hand.

The hand goes from place to place; each step begins when the one before is seen to be done. What differs is how the
finger closes: the elbow comes to the trunk and the hand is held (`NullSpace`), or a button is pressed (`Pressing`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from typing import Final, cast

import numpy as np

from srl.runtime.contracts.rotation import Pose, Quaternion, Vector, conjugate, matrix, product, turned
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Hold
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.models.body import Body
from srl.sim.devices.ring.fake import FakeRing
from srl.sim.parts.body import arm_posture
from srl.sim.parts.body.upper_body import UpperBodyPart
from srl.sim.parts.body.wearer_config import UpperBodyConfig
from srl.sim.parts.hand.ycb import Ycb
from srl.studies.ikns.grasp import Task, wrist
from srl.studies.simulated import cell

VALUE: Final = "intent.c"
OPENED: Final = 1.0
"""Share of the swivel's range at which the finger is open: the elbow outwards. A finger that is worn on the forearm
turns away from the palm when the elbow goes out, so the other sense works against itself."""
CLOSED: Final = 0.0
SEEN: Final = 0.2  # s, from what finger and object do to what is decided: ours
_RESTS: Final = 0.06  # rad in that time, below which a finger is seen to rest; ours
_GAPES: Final = 0.35  # rad, by which a finger is seen to have opened; ours
_PRESS: Final = 0.15  # s, for which the ring's button is down; ours
_HALF: Final = 0.5**0.5
# The hand's frame in the body's hand: x to the little finger, y distal, z dorsal, where the body has -x, -z and -y.
HAND: Final[Quaternion] = (0.0, 0.0, _HALF, -_HALF)
_HEADINGS: Final = np.arange(-0.9, 1.2, 0.05).tolist()  # rad


class Grasping:
    """A `Grasper` whose hand a simulated wearer moves. Who derives says how the finger closes.

    Attributes:
        leak: m, the farthest that the hand was from where it was meant to be while the finger closed.
        closing: s, that the last closing took.
    """

    def __init__(self, lockstep: Lockstep, part: UpperBodyPart, chest: Pose) -> None:
        """Args: chest, where the wearer's chest is in the world."""
        world = cell(lockstep)
        truth = world.truth_arrays
        self._lockstep, self._part, self._chest = lockstep, part, chest
        self._contact: Array = truth["finger_contact"]
        self._finger: Array = truth["finger_position"]
        self._leak: Array = truth["wearer_leak"]
        self._rate = 1e9 / lockstep.period
        self._late = round(SEEN * self._rate)
        self._sights: list[tuple[bool, Array]] = []  # since the last decision: whether it touches, its posture, rad
        self._hold = Hold((0.0, 0.0, 0.0))
        self._closes = self._done = False
        self.leak = self.closing = 0.0

    def reach(self, wrist: Pose, seconds: float) -> None:
        """Takes the hand there; how long it takes is the wearer's affair."""
        point, turn = hand_at(self._part.body, self._chest, wrist)
        self._hold = replace(self._hold, point=point, turn=turn)
        self._part.wearer.instruct(self._hold)

    @property
    def arrived(self) -> bool:
        """Whether the hand is there, as exactly as the wearer can tell."""
        return self._part.wearer.done

    def squeeze(self, c: float) -> None:
        """Begins to close the finger (1), or to open it (0)."""
        self._closes, self._done = c > 0.5, False
        self._sights = []

    @property
    def squeezed(self) -> bool:
        """Whether the finger was seen to press and rest, or to have let go."""
        return self._done

    def _judged(self) -> bool:
        """The same, by what was seen up to now."""
        seen = self._sights[: -self._late][-self._late :]
        if len(seen) < self._late:
            return False
        touched = float(np.mean([touches for touches, _ in seen]))
        if self._closes:  # an unsteady hand loses touch now and then
            return touched > 0.5 and float(np.abs(seen[-1][1] - seen[0][1]).max()) < _RESTS
        return touched == 0.0 and float(np.abs(seen[-1][1] - self._sights[0][1]).max()) > _GAPES

    def watch(self) -> None:
        """Looks: to be called after every step."""
        self._sights.append((bool(self._contact[0] > 0.0), self._finger.copy()))
        self._done = self._done or self._judged()
        if self._closes and not self._done:
            self.closing = len(self._sights) / self._rate
            self.leak = max(self.leak, float(self._leak[0]))


class NullSpace(Grasping):
    """Closes and opens by the elbow's swivel, while the hand is held."""

    def __init__(self, lockstep: Lockstep, part: UpperBodyPart, chest: Pose) -> None:
        super().__init__(lockstep, part, chest)
        self._hold = replace(self._hold, swivel=OPENED)

    def squeeze(self, c: float) -> None:
        """Moves the elbow to the end that closes or opens."""
        super().squeeze(c)
        self._hold = replace(self._hold, swivel=CLOSED if self._closes else OPENED)
        self._part.wearer.instruct(self._hold)

    def _judged(self) -> bool:
        """Closing, the elbow must be there, too."""
        return (self._part.wearer.done or not self._closes) and super()._judged()


class Pressing(Grasping):
    """Closes and opens by presses of the profile's ring, a reaction time after it is decided. The elbow hangs."""

    def __init__(self, lockstep: Lockstep, part: UpperBodyPart, chest: Pose) -> None:
        super().__init__(lockstep, part, chest)
        self._hold = replace(self._hold, swivel=CLOSED)
        (self._ring,) = (d.driver for d in lockstep.devices if isinstance(d.driver, FakeRing))
        reaction = cast(UpperBodyConfig, part.config).reaction
        self._from, self._to = round(reaction * self._rate), round((reaction + _PRESS) * self._rate)
        self._decided = False

    def squeeze(self, c: float) -> None:
        """Decides to press."""
        super().squeeze(c)
        self._decided = True

    def _judged(self) -> bool:
        """The button must have been pressed before."""
        return len(self._sights) > self._to + self._late and super()._judged()

    def watch(self) -> None:
        """Looks, and presses."""
        super().watch()
        self._ring.press(self._decided and self._from <= len(self._sights) < self._to)


KINDS: Final[Mapping[str, type[Grasping]]] = {"ikns": NullSpace, "ring": Pressing}
"""By condition, which is the profile's `input`, too."""


def heading(body: Body, chest: Pose, task: Task, thing: Ycb, place: tuple[float, float], swivel: float) -> float:
    """rad: the hand's heading with which the wrist is straight at a place, the object in hand."""
    arm = arm_posture.ArmPosture(body, "right")
    found, least = 0.0, inf
    for angle in _HEADINGS:
        point, turn = hand_at(body, chest, wrist(replace(task, heading=angle, turn=0.0), thing, place))
        bent = abs(float(arm.solve(arm_posture.Hold(np.array(point), matrix(turn)), swivel)[7]))
        if bent < least:
            found, least = angle, bent
    return found


def hand_at(body: Body, chest: Pose, wrist: Pose) -> tuple[Vector, Quaternion]:
    """The right palm's middle (m) and the hand's orientation in the chest's frame, for the passive hand's frame.

    Args:
        chest, wrist: poses in the world, x y z (m), w x y z.
    """
    back = conjugate(chest[3:])
    turn = product(back, product(wrist[3:], conjugate(HAND)))
    x, y, z = turned(back, (wrist[0] - chest[0], wrist[1] - chest[1], wrist[2] - chest[2]))
    gx, gy, gz = turned(turn, body.grip("right"))
    return (x + gx, y + gy, z + gz), turn
