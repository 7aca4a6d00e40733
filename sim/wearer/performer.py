"""A simulated person who stands, walks, and does what the whole body is told to do.

Pure: what was told when, and time, give the posture; the same time gives the same bits.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS, Skeleton, is_finger
from srl.runtime.contracts.rotation import EulerQuaternions, exp
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Everyday, Instruction, Perform, Rest, Return, Walk
from srl.sim.wearer.actions import at_ease, beyond_ease, waving
from srl.sim.wearer.gait import RADIUS, add_gait, walked
from srl.sim.wearer.motion import minimum_jerk, quintic
from srl.sim.wearer.people import Subject, sway
from srl.sim.wearer.reaching import Reaching

_START: Final = 1.5  # s, from standing to walking, and back
_FADE: Final = 0.3  # s, in which what is repeated sets in
_EVERYDAY: Final = 0xDA1  # seed of what a person reaches for


@dataclass(frozen=True)
class _Instructed:
    """From `since` s on, the person goes from `before` (59, 3) degrees to `after`, and repeats `again` there."""

    since: float
    given: Instruction
    before: Array
    after: Array
    again: Array
    walked: float  # s of walking before
    gain: float  # of the gait, before
    late: float  # s, from being told to beginning


class Performer:
    """A motion: see `at`. It begins at ease; `instruct` says what else to do.

    Attributes:
        offsets: (59, 3) m, of the person.
        subject: who it is.
    """

    def __init__(self, who: Subject, skeleton: Skeleton, scale: float = 1.0) -> None:
        """`scale`: of the default body, beside the person's own."""
        self.subject = who
        self._scale = scale * who.scale
        self.offsets = skeleton.offsets * self._scale
        self._index = {joint: i for i, joint in enumerate(skeleton.names)}
        self._ease = at_ease(self._index) + who.ease
        self._frequency, self._phase, amplitude = sway(who.number)
        still = np.array([[0.0 if is_finger(name) else 1.0] for name in skeleton.names])
        self._sway = amplitude * still
        self._quaternions = EulerQuaternions("YXZ", JOINTS)
        self._reaching = Reaching((who.number, _EVERYDAY), self._index)
        self._instructed = [
            _Instructed(-np.inf, Rest(), self._ease, self._ease, np.zeros((JOINTS, 3)), 0.0, 0.0, who.reaction)
        ]

    def instruct(self, t: float, given: Instruction) -> None:
        """From t s on does this: Rest, Walk, Return, Perform or Everyday. Raises ValueError: it can't, or is early."""
        if not isinstance(given, Rest | Walk | Return | Perform | Everyday):
            raise ValueError(f"a whole body can't do {type(given).__name__}: Rest, Walk, Return, Perform or Everyday")
        if t < self._instructed[-1].since:
            raise ValueError("instructions come in the order of time")
        after, again = self._ease, np.zeros((JOINTS, 3))
        if isinstance(given, Perform):
            pose = beyond_ease(given.action, self._index)
            after = self._ease + self.subject.style(given.action, pose, len(self._instructed))
            again = waving(given.action, self._index)
        last = self._instructed[-1]
        distance, gain = self._gait(last, t)
        late = self._lap_ends(distance, gain) if isinstance(given, Return) else self.subject.reaction
        self._instructed.append(_Instructed(t, given, self._posture(last, t), after, again, distance, gain, late))

    def forget(self, count: int) -> None:
        """Takes back all instructions but the first `count`."""
        del self._instructed[1 + count :]

    @property
    def count(self) -> int:
        """Number of instructions so far."""
        return len(self._instructed) - 1

    def there(self, t: float) -> bool:
        """Whether at t s the person has come where the last instruction leads."""
        who, instructed = self.subject, self._instructed[-1]
        takes = (
            _START
            if isinstance(instructed.given, Walk) or instructed.gain > 0.0
            else who.move + float(who.stagger.max())
        )
        return t >= instructed.since + instructed.late + takes

    def at(self, t: float) -> tuple[Array, Array]:
        """Hips (3,), m, and unit quaternions (59, 4), w x y z, at t seconds."""
        instructed = self._instructed[max(bisect_right(self._instructed, t, key=lambda each: each.since) - 1, 0)]
        angles = self._posture(instructed, t) + self._sway * np.sin(2.0 * np.pi * self._frequency * t + self._phase)
        hips = self.offsets[0].copy()
        hips[1] -= self._sunk(angles)
        distance, gain = self._gait(instructed, t)
        add_gait(hips, angles, self._index, distance, gain, self._scale, self.subject.walk)
        rotations = np.empty((JOINTS, 4))
        self._quaternions.fill(np.deg2rad(angles), rotations)
        return hips, rotations

    def _posture(self, instructed: _Instructed, t: float) -> Array:
        """(59, 3) degrees, without sway and gait."""
        who = self.subject
        late = t - instructed.since - who.reaction
        share = minimum_jerk((late - who.stagger) / who.move)[:, None] if np.isfinite(instructed.since) else 1.0
        angles = instructed.before + share * (instructed.after - instructed.before)
        more = late - who.move
        if isinstance(instructed.given, Everyday) and more > 0.0:
            angles = angles + self._reaching.at(more)
        elif more > 0.0 and np.isfinite(more):
            fade = quintic(min(more / _FADE, 1.0))
            angles = angles + fade * np.sin(2.0 * np.pi * who.frequency * more) * instructed.again
        return np.asarray(angles)

    def _gait(self, instructed: _Instructed, t: float) -> tuple[float, float]:
        """s of walking at full speed until t, and the gain of the gait."""
        change = (1.0 if isinstance(instructed.given, Walk) else 0.0) - instructed.gain
        since = t - instructed.since if np.isfinite(instructed.since) else 0.0
        late = max(since - instructed.late, 0.0)
        gain = instructed.gain + change * float(minimum_jerk(np.array(late / _START)))
        return instructed.walked + instructed.gain * since + change * walked(late, _START), gain

    def _lap_ends(self, distance: float, gain: float) -> float:
        """s after which to begin to stop, so that a whole number of circles has been walked: then all is as at first.

        Args:
            distance: s of walking so far.
            gain: of the gait; 0: the person stands.
        """
        who = self.subject
        if gain <= 0.0:
            return who.reaction
        lap = 2.0 * np.pi * RADIUS / who.walk
        # Stopping takes as long as half of it at full speed.
        least = distance + gain * (who.reaction + 0.5 * _START)
        return float((np.ceil(least / lap) * lap - distance) / gain - 0.5 * _START)

    def _sunk(self, angles: Array) -> float:
        """m, by which the hips are lower than on straight legs: the mean of both legs, from their pitch alone."""
        sunk = 0.0
        lean = np.deg2rad(angles[0, 1])
        for side in ("Left", "Right"):
            thigh, shank = (-self.offsets[self._index[f"{side}{part}"], 1] for part in ("Leg", "Foot"))
            hip, knee = np.deg2rad(angles[[self._index[f"{side}UpLeg"], self._index[f"{side}Leg"]], 1])
            sunk += 0.5 * (thigh * (1.0 - np.cos(lean + hip)) + shank * (1.0 - np.cos(lean + hip + knee)))
        return float(sunk)


def measured(
    person: Performer, times: Array, misfit: float = 0.0, noise: float = 0.0, seed: int = 0
) -> tuple[Array, Array]:
    """What a suit gives of a motion, without physics: rotation (T, 59, 4) and translation (T, 59, 3), m.

    Args:
        person: who moves.
        times: (T,) s.
        misfit: degrees rms about all axes, by which each joint's rotation is off all the time.
        noise: rad, SD of each joint about each axis, in each sample.
        seed: of both.
    """
    rng = np.random.default_rng([seed, 0x501])
    off = np.deg2rad(rng.normal(0.0, misfit / np.sqrt(3.0), (JOINTS, 3)))
    turn = np.array([exp(*row) for row in off.tolist()])
    poses = [person.at(t) for t in times.tolist()]
    q = np.array([rotations for _, rotations in poses])
    q = _product(q, turn)
    if noise > 0.0:
        q = _product(
            q, np.concatenate([np.ones((*q.shape[:2], 1)), rng.normal(0.0, 0.5 * noise, (*q.shape[:2], 3))], 2)
        )
    translation = np.tile(person.offsets, (len(times), 1, 1))
    translation[:, 0] = [hips for hips, _ in poses]
    return q / np.linalg.norm(q, axis=2, keepdims=True), translation


def _product(a: Array, b: Array) -> Array:
    """Quaternion products (..., 4)."""
    w, v = (
        a[..., :1] * b[..., :1] - np.sum(a[..., 1:] * b[..., 1:], axis=-1, keepdims=True),
        np.cross(a[..., 1:], b[..., 1:]),
    )
    return np.concatenate([w, a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + v], axis=-1)
