"""Fits a recorded hand into the wearer's joint ranges, and says what is lost.

Another hand's sensors have other zeros: a suit's thumb may be 40 degrees from where the model's is. Clipped, such a
joint stands still at a limit. So a joint of which clipping would take too much is shifted as a whole, or scaled where
its motion is wider than its range. What still lies outside is clipped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import BEYOND, JOINTS, RANGES

CONSTANT: Final = np.deg2rad(0.1)  # a joint that moves less wasn't measured
MUCH: Final = 0.3
"""Share of a joint's variation: where clipping takes more, the joint is fitted.

Below it clipping is nearer to what was recorded: a shift is there in every sample, clipping only in some. Ours, after
the recordings in docs/simulation.md, which come out alike from 0.22 to 0.6."""
REFUSED: Final = 0.5  # share of a joint's variation: a recording that loses more, fitted, is another motion
FURTHEST: Final = np.deg2rad(60.0)  # no sensor's zero is off by more: then it is another joint, sign or unit
REMEDY: Final = "If the wearer's joints do reach so far, give their `lower` and `upper` to the hand under `models:`"
_WARN: Final = 0.01  # share of samples
_MIRRORED: Final = 0.1  # share of its variation: a shifted joint that loses less when negated may have another sign
_STILL: Final = np.deg2rad(5.0)  # a hand that moves less may be in another unit
_TAILS: Final = (1.0, 99.0)  # percentiles that must lie within a range: a few outliers don't move a joint


@dataclass(frozen=True)
class Loss:
    """What lies outside the ranges, and what clipping it takes.

    Attributes:
        share: of the samples, those with a joint more than 2 degrees outside its range.
        joint: the one that loses most of its variation; "" if none loses any.
        variation: the share of that joint's standard deviation that is lost.
    """

    share: float
    joint: str
    variation: float

    def __str__(self) -> str:
        outside = f"{self.share:.1%} of the samples are more than 2 degrees outside the hand's ranges"
        most = f"{self.joint} loses {self.variation:.1%} of its variation" if self.joint else "no joint loses variation"
        return f"{outside}, and {most}"


@dataclass(frozen=True)
class Fitted:
    """A recorded motion within the ranges.

    Attributes:
        position: (n, 20) rad.
        shifts: rad, by joint.
        scales: factors of what lies below and above zero, by joint.
        clipped: what would be lost if the recording were only clipped; lost: what is lost.
        constant: joints that don't move, so probably weren't measured.
        mirrored: shifted joints that would fit as they are, were they negated.
        still: whether no joint moves by more than 5 degrees.
        unused: columns of the file from which nothing is taken.
    """

    position: Array
    shifts: dict[str, float]
    scales: dict[str, tuple[float, float]]
    clipped: Loss
    lost: Loss
    constant: tuple[str, ...]
    mirrored: tuple[str, ...]
    still: bool
    unused: tuple[str, ...] = ()

    @property
    def doubtful(self) -> bool:
        """Whether a person should be warned: a joint had to be fitted, much is outside, or all but nothing moves."""
        return bool(self.shifts or self.scales) or self.still or self.clipped.share > _WARN

    def lines(self) -> list[str]:
        """Returns what a person should know, a line each: what is outside, what was done, what is lost."""
        done = [f"{joint} is shifted by {np.rad2deg(by):+.1f} degrees" for joint, by in self.shifts.items()]
        done += [f"{joint} is scaled by {a:.2f} below and {b:.2f} above zero" for joint, (a, b) in self.scales.items()]
        done += [f"{joint} would fit without a shift if it were negated: is its sign ours?" for joint in self.mirrored]
        if self.still:
            done.append("no joint moves by more than 5 degrees: are these degrees, and not radian?")
        lines = [f"as recorded, {self.clipped}", *done, f"so fitted, {self.lost}"] if done else [f"{self.lost}"]
        if self.doubtful:
            lines.append(REMEDY)
        return lines


def fit(position: Array, ranges: Array = RANGES, much: float = MUCH) -> Fitted:
    """Returns the motion within the ranges.

    A joint of which clipping would take more than `much` of the variation is shifted by as little as brings its 1st to
    99th percentile into its range. Where they are further apart than the limits, what lies below zero and what lies
    above it is scaled, each by as little; where zero is outside the range, the limit next to it takes its place.

    Args:
        position: (n, 20) rad, as recorded.
        ranges: (20, 2) rad, the wearer's.
        much: the share of a joint's variation above which it is fitted, not clipped.
    """
    lower, upper = ranges[:, 0], ranges[:, 1]
    constant = np.ptp(position, axis=0) < CONSTANT
    made = position.copy()
    shifts: dict[str, float] = {}
    scales: dict[str, tuple[float, float]] = {}
    taken = _taken(position, np.clip(position, lower, upper))
    for j in np.flatnonzero((taken > much) & ~constant):
        low, high = (float(v) for v in np.percentile(position[:, j], _TAILS))
        if high - low <= upper[j] - lower[j]:
            shifts[JOINTS[j]] = by = max(lower[j] - low, 0.0) - max(high - upper[j], 0.0)
            made[:, j] += by
        else:
            zero = min(max(0.0, lower[j]), upper[j])
            below = (lower[j] - zero) / (low - zero) if low < lower[j] else 1.0
            above = (upper[j] - zero) / (high - zero) if high > upper[j] else 1.0
            scales[JOINTS[j]] = below, above
            away = position[:, j] - zero
            made[:, j] = zero + np.where(away < 0.0, below, above) * away
    inside = np.clip(made, lower, upper)
    return Fitted(
        inside, shifts, scales, _loss(position, position, ranges), _loss(position, made, ranges),
        tuple(JOINTS[j] for j in np.flatnonzero(constant)),
        tuple(joint for joint, taken in zip(JOINTS, _taken(-position, np.clip(-position, lower, upper)), strict=True)
              if joint in shifts and taken < _MIRRORED),
        bool(np.ptp(position, axis=0).max() < _STILL),
    )  # fmt: skip


def check(place: Path | str, fitted: Fitted) -> None:
    """Refuses a recording of which too little is left.

    Raises:
        RecordingError: a joint loses more than half its variation, or is shifted by more than 60 degrees.
    """
    remedy = f"Are these radian (name the columns ..._deg if not), and the joints' own names and signs? {REMEDY}"
    for joint, by in fitted.shifts.items():
        if abs(by) > FURTHEST:
            problem = f"{joint} would have to be shifted by {np.rad2deg(by):+.0f} degrees into its range"
            raise RecordingError(f"{place}, joint '{joint}'", problem, remedy)
    if fitted.lost.variation > REFUSED:
        problem = f"{fitted.lost.variation:.0%} of its variation doesn't fit into its range"
        raise RecordingError(f"{place}, joint '{fitted.lost.joint}'", problem, remedy)


def _taken(recorded: Array, used: Array) -> Array:
    """(20,): the share of each joint's standard deviation that is lost; 0 for one that doesn't move."""
    before = recorded.std(axis=0)
    return np.where(np.ptp(recorded, axis=0) < CONSTANT, 0.0, 1.0 - used.std(axis=0) / np.maximum(before, 1e-12))


def _loss(recorded: Array, made: Array, ranges: Array) -> Loss:
    used = np.clip(made, *ranges.T)
    taken = _taken(recorded, used)
    worst = int(np.argmax(taken))
    share = float((np.abs(made - used).max(axis=1) > BEYOND).mean())
    return Loss(share, JOINTS[worst] if taken[worst] > 0.0 else "", max(float(taken[worst]), 0.0))
