"""Simulated people who do the ten actions, and what a suit measures of them, without physics: fast enough for many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, get_args

import numpy as np

from srl.control.intention.features import RATE, frames, joints, trunk_of
from srl.control.intention.training import EVERYDAY, Thresholds, Trial
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Action, Everyday, Perform, Rest, Walk
from srl.sim.parts.body.motion import Script, Scripted
from srl.sim.wearer.people import MISFIT, subject
from srl.sim.wearer.performer import Performer, measured

SKELETON: Final = Skeleton("axis-neuron")
TRUNK: Final = trunk_of(SKELETON.names)
JOINTS: Final = np.array([SKELETON.names.index(name) for name in joints(TRUNK)])
ACTIONS: Final[tuple[Action, ...]] = get_args(Action)
DT: Final = 1.0 / RATE
_NOISE: Final = 0.002  # rad, of the suit, as in its fake
_STAND, _ACTION, _PAUSE, _WALK = 5.0, 3.0, 2.5, 8.0  # s
_AFTER: Final = 0.6  # s after an action's end in which it may still hold


@dataclass(frozen=True)
class Session:
    """What a suit measured at RATE.

    Attributes:
        times: (T,) s.
        rotation: (T, n, 4) w x y z of the law's joints in their parents.
        translation: (T, n, 3) m.
        labels: from, to (s), label, and number of the repetition, from 0 on.
    """

    times: Array
    rotation: Array
    translation: Array
    labels: tuple[tuple[float, float, str, int], ...]

    def trials(self, group: int | None = None, thresholds: Thresholds | None = None) -> list[Trial]:
        """The labelled stretches. `group`: of all, instead of the repetition."""
        lead, made = (thresholds or Thresholds()).lead, frames(self.rotation, self.translation)
        found = []
        for begin, end, label, repetition in self.labels:
            at = (self.times >= begin + (lead if label in ACTIONS else 0.0)) & (self.times < end)
            found.append(Trial(label, repetition if group is None else group, made[at]))
        return found

    def held(self, action: Array, labels: tuple[str, ...]) -> list[tuple[str, set[str]]]:
        """Per action that was done: its name, and those that held from its word to a little after its end.

        Args:
            action: (T, k) of the law.
            labels: (k,) names.
        """
        rows = []
        for begin, end, label, _ in self.labels:
            if label in labels:
                at = (self.times >= begin) & (self.times < end + _AFTER)
                here = np.atleast_1d(action[at].any(axis=0))
                rows.append((label, {name for name, on in zip(labels, here, strict=True) if on}))
        return rows


def session(number: int, repetitions: int = 3, seed: int = 0, misfit: float = MISFIT) -> Session:
    """A simulated person's session: in each repetition it stands, does each action in a drawn order, and walks.

    Args:
        number: who it is (`srl.sim.wearer.people`).
        repetitions: of each action.
        seed: of the order, of how the suit sits, and of its noise.
        misfit: degrees rms, by which the suit is off.
    """
    rng, person = np.random.default_rng([number, seed]), Performer(subject(number, SKELETON.names), SKELETON)
    t, labels = 0.0, list[tuple[float, float, str, int]]()
    for repetition in range(repetitions):
        person.instruct(t, Rest())
        labels.append((t + 2.0, t + _STAND, "stand", repetition))
        t += _STAND
        for k in rng.permutation(len(ACTIONS)):
            person.instruct(t, Perform(ACTIONS[k]))
            person.instruct(t + _ACTION, Rest())
            labels.append((t, t + _ACTION, ACTIONS[k], repetition))
            t += _ACTION + _PAUSE
        person.instruct(t, Walk())
        labels.append((t + 2.0, t + _WALK, "walk", repetition))
        t += _WALK
    times = np.arange(0.0, t, DT)
    rotation, translation = measured(person, times, misfit, _NOISE, seed=1000 * number + seed)
    return Session(times, rotation[:, JOINTS], translation[:, JOINTS], tuple(labels))


def everyday(number: int, seconds: float = 185.0, seed: int = 0, misfit: float = MISFIT) -> Trial:
    """A simulated person's everyday motion: half of the time it reaches about, a quarter each it walks and stands."""
    person = Performer(subject(number, SKELETON.names), SKELETON)
    person.instruct(0.0, Everyday())
    person.instruct(0.5 * seconds, Walk())
    person.instruct(0.75 * seconds, Rest())
    seed = 1000 * number + seed + 500
    rotation, translation = measured(person, np.arange(0.0, seconds, DT), misfit, _NOISE, seed=seed)
    return Trial(EVERYDAY, 0, frames(rotation[:, JOINTS], translation[:, JOINTS]))


def unrelated(kind: Script, seconds: float, seed: int = 1) -> tuple[Array, Array]:
    """What an ideal suit measures of the cell's scripted person, who knows no action: rotation and translation."""
    motion = Scripted(kind, SKELETON, 1.0, seed, "person")
    poses = [motion.at(t) for t in np.arange(0.0, seconds, DT).tolist()]
    translation = np.tile(motion.offsets, (len(poses), 1, 1))
    translation[:, 0] = [hips for hips, _ in poses]
    return np.array([q for _, q in poses])[:, JOINTS], translation[:, JOINTS]


def onsets(action: Array) -> list[int]:
    """The numbers of the actions that began, in turn; `action` (T, k)."""
    held = np.where(action.any(axis=1), action.argmax(axis=1), -1)
    return [int(now) for before, now in zip([-1, *held[:-1]], held, strict=True) if now not in (before, -1)]
