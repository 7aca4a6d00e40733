"""Simulated people who differ: in size, pace, posture, style, and in how their suit sits.

Sources: stature from ANSUR II (Gordon et al. 2014, NATICK/TR-15/007); reaction from the motor-control literature (0.2
to 0.3 s to a sign that is seen); errors of a suit's joint angles from Wu et al. 2022 (1.9 to 12.5 degrees rms). What
has no source there is ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS, is_finger
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Action
from srl.sim.wearer.actions import HANG

Sex = Literal["male", "female"]
_STATURE: Final[dict[Sex, tuple[float, float]]] = {"male": (1.756, 0.069), "female": (1.629, 0.064)}  # m, mean and SD
_DEFAULT: Final = 1.725  # m, stature of the default body: its hips are at 0.53 of it (Drillis and Contini 1966)
_REACTION: Final = (0.20, 0.30)  # s
_MOVE: Final = (0.9, 0.2)  # s, mean and SD of a movement; ours
_LEAST_MOVE: Final = 0.5  # s
_POSTURE: Final = 4.0  # degrees, SD of each joint's angles at ease; ours
_EXTENT: Final = 0.12  # SD, of how far each person goes in an action, as a share; ours
_STYLE: Final = 6.0  # degrees, SD of each moved joint's angles in an action, between people; ours
_REPEAT: Final = (0.05, 3.0)  # the same from one repetition to the next: share, degrees; ours
_STAGGER: Final = 0.08  # s, SD of when each joint begins; ours
_SWAY: Final = 1.0  # degrees, SD of a joint's slow sway; ours
MISFIT: Final = 4.0  # degrees rms, by which the suit's angles are off in a session: within Wu's 1.9 to 12.5


@dataclass(frozen=True)
class Subject:
    """Who moves, and how.

    Attributes:
        number: who; the same number is the same person.
        sex: as in ANSUR II.
        scale: size, of the default body.
        reaction: s, from being told to moving.
        move: s that a movement takes.
        walk: m/s, for a person of scale 1.
        ease: (59, 3) degrees, added to the posture at ease.
        stagger: (59,) s, by which each joint is late.
        frequency: Hz, of what is repeated, such as waving.
    """

    number: int
    sex: Sex
    scale: float
    reaction: float
    move: float
    walk: float
    ease: Array
    stagger: Array
    frequency: float

    def style(self, action: Action, pose: Array, repetition: int) -> Array:
        """(59, 3) degrees: how this person does an action the n-th time, from the prescribed `pose` (59, 3)."""
        if not self.number:
            return pose
        own = np.random.default_rng([self.number, *action.encode()])
        again = np.random.default_rng([self.number, repetition, *action.encode()])
        moved = np.abs(pose).max(axis=1, keepdims=True) > 0.0
        made = pose.copy()
        for rng, extent, style in ((own, _EXTENT, _STYLE), (again, *_REPEAT)):
            made = made * rng.normal(1.0, extent) + moved * rng.normal(0.0, style, (JOINTS, 3))
        return np.asarray(made)


def subject(number: int, names: tuple[str, ...]) -> Subject:
    """The simulated person of a number; `names` (59) of the joints. Number 0 is the average man, as prescribed."""
    rng = np.random.default_rng([number, 0x5EB])
    sex: Sex = "male" if rng.random() < 0.5 else "female"
    stature = rng.normal(*_STATURE[sex])
    body = np.array([[0.0 if is_finger(name) or name == "Hips" else 1.0] for name in names])
    ease = body * rng.normal(0.0, _POSTURE, (JOINTS, 3))
    # Both arms hang more or less alike; only what is left differs between the sides.
    hang = rng.normal(0.0, _POSTURE)
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        ease[names.index(f"{side}Arm"), 2] = sign * np.clip(hang + rng.normal(0.0, 2.0), HANG - 90.0, HANG - 50.0)
    made = Subject(
        number, sex, stature / _DEFAULT, rng.uniform(*_REACTION), max(rng.normal(*_MOVE), _LEAST_MOVE),
        rng.uniform(0.7, 1.2), ease, np.abs(rng.normal(0.0, _STAGGER, JOINTS)), rng.uniform(1.0, 1.8),
    )  # fmt: skip
    if number:
        return made
    average = _STATURE["male"][0] / _DEFAULT
    return Subject(0, "male", average, 0.25, _MOVE[0], 1.0, np.zeros((JOINTS, 3)), np.zeros(JOINTS), 1.4)


def sway(number: int) -> tuple[Array, Array, Array]:
    """A person's slow sway: frequencies (59, 3) Hz, phases (59, 3) rad, amplitudes (59, 3) degrees."""
    rng = np.random.default_rng([number, 0x5A1])
    shape = (JOINTS, 3)
    return rng.uniform(0.1, 0.5, shape), rng.uniform(0.0, 2.0 * np.pi, shape), rng.normal(0.0, _SWAY, shape)
