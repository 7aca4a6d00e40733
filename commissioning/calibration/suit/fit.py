"""The heading of a suit and the drift of its segments, from a person who stands the same way again and again.

Gravity tells an inertial sensor where up is; nothing tells its heading but the earth's field, which iron bends. So a
segment's error is a turn about the vertical that changes with time. While the person stands in the same pose and faces
the same way, a segment's heading is the same but for this error: a straight line through the stands is its drift. What
the person's own turn is and what the drift of all segments together can only be told by the marks on the floor.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.suit.segments import SuitError, along, back, chest, heading, product, tilt
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

PER_MINUTE: Final = np.degrees(60.0)  # degrees a minute of a rad/s
_FIXED: Final = 1e-4  # rad, by which a segment without a sensor doesn't turn in its parent
_REST: Final = 1e-6  # rad, of a suit that sends its joints at rest


class Thresholds(Options):
    """What a calibration must reach."""

    drift: float = Field(2.0, gt=0, le=60, description="deg/min, by which a segment may drift")
    sure: float = Field(1.0, gt=0, le=60, description="deg/min, greatest standard deviation of a drift")
    still: float = Field(0.2, gt=0, le=0.5, description="rad, by which a segment may turn in a stand")
    same: float = Field(0.26, gt=0, le=1, description="rad, by which a segment may be tilted unlike in the first stand")
    upright: float = Field(0.35, gt=0, le=1, description="rad, by which hips and chest may be tilted")
    arms: float = Field(0.6, gt=0, le=1.2, description="rad, by which an upper arm may be off the pose")
    agree: float = Field(0.26, gt=0, le=1, description="rad, by which hips and chest may face differently")
    back: float = Field(0.6, gt=0, le=1.5, description="rad, by which the hips may face unlike in the first stand")


@dataclass(frozen=True)
class Stands:
    """What a person's stands gave, K of them, n segments.

    Attributes:
        times: (K,) s, of their middle.
        turned: (K, n, 4) w x y z, mean in the suit's world.
        moved: (n,) rad: how far each segment turned in its parent, over the whole time.
    """

    times: Array
    turned: Array
    moved: Array


@dataclass(frozen=True)
class Suit:
    """What was found, K stands, n segments.

    Attributes:
        segments: (n,) names.
        stands: what it is from.
        headings: (K, n) rad, how far each segment is turned to the left since the first stand.
        tilts: (K, n) rad, how far else.
        rates: (n,) rad/s, of the straight line through the headings.
        uncertain: (n,) rad/s, standard deviation.
        heading: rad, of hips and chest at the end, in the suit's world.
        scatter: rad, standard deviation of it.
        measured: (n,) whether a segment moves by itself.
    """

    segments: tuple[str, ...]
    stands: Stands
    headings: Array
    tilts: Array
    rates: Array
    uncertain: Array
    heading: float
    scatter: float
    measured: np.ndarray

    @property
    def whole(self) -> float:
        """rad/s: the mean drift of hips and chest, which is that of the suit as a whole, or the person's own turn."""
        return float(self.rates[[0, chest(self.segments)]].mean())


def fit(segments: Sequence[str], stands: Stands) -> Suit:
    """Computes it; `segments` (n,) are the names, the hips first."""
    since = product(stands.turned, back(stands.turned[0]))
    headings = np.unwrap(heading(since), axis=0)
    t = stands.times - stands.times.mean()
    spread = float(t @ t)
    rates = t @ headings / spread
    left = headings - headings.mean(axis=0) - np.outer(t, rates)
    scatter = np.sqrt((left**2).sum(axis=0) / (len(t) - 2))
    both = [0, chest(segments)]
    first = heading(stands.turned[0, both])
    line = headings.mean(axis=0) + t[-1] * rates
    facing = first + line[both]
    middle = np.arctan2(np.sin(facing).mean(), np.cos(facing).mean())
    # Of the line's value at its end.
    sure = float(scatter[both].mean() * np.sqrt(1.0 / len(t) + t[-1] ** 2 / spread))
    return Suit(
        tuple(segments), stands, headings, tilt(since), rates, scatter / np.sqrt(spread), float(middle), sure,
        stands.moved > _FIXED,
    )  # fmt: skip


def pose_fault(turned: Array, segments: Sequence[str], pose: Literal["n", "t"], thresholds: Thresholds) -> str:
    """What is wrong with a pose, (n, 4) in the world; "" for nothing."""
    for name in ("Hips", segments[chest(segments)]):
        lean = np.arccos(np.clip(along(turned[segments.index(name)], (0.0, 1.0, 0.0))[1], -1.0, 1.0))
        if lean > thresholds.upright:
            return f"{name} leans by {np.degrees(lean):.0f} degrees: stand upright"
    for side, sign in (("Right", -1.0), ("Left", 1.0)):
        bone = along(turned[segments.index(f"{side}Arm")], (sign, 0.0, 0.0))
        off = np.arccos(np.clip(-bone[1], -1.0, 1.0)) if pose == "n" else abs(np.arcsin(np.clip(bone[1], -1.0, 1.0)))
        if off > thresholds.arms:
            want = "let the arms hang" if pose == "n" else "hold the arms out"
            return f"{side}Arm is off the pose by {np.degrees(off):.0f} degrees: {want}"
    return ""


def refusals(found: Suit, pose: Literal["n", "t"], thresholds: Thresholds) -> tuple[SuitError, ...]:
    """Why the suit can't be used; none if it can."""
    for reasons in (_uncalibrated, _posed, _drifting):
        if errors := tuple(reasons(found, pose, thresholds)):
            return errors  # what is measured in another pose says nothing about drift
    return ()


def _uncalibrated(found: Suit, pose: str, thresholds: Thresholds) -> Iterator[SuitError]:
    if not found.measured.any() or float(found.stands.moved.max()) < _REST:
        problem = "none of its joints has moved"
        yield SuitError("suit", problem, "Calibrate it in its own program, and see to the hub: it sends joints at rest")
    elif not found.measured[0]:
        yield SuitError("Hips", "they haven't turned at all", "See to the sensor on the hips, and walk and turn")


def _posed(found: Suit, pose: Literal["n", "t"], thresholds: Thresholds) -> Iterator[SuitError]:
    for number, turned in enumerate(found.stands.turned, 1):
        if fault := pose_fault(turned, found.segments, pose, thresholds):
            yield SuitError(f"stand {number}", fault, f"Do it again: r {number}, or begin anew")
    hips, top = 0, chest(found.segments)
    apart = abs(float(heading(product(found.stands.turned[0, top], back(found.stands.turned[0, hips])))))
    if apart > thresholds.agree:
        problem = f"hips and chest face {np.degrees(apart):.0f} degrees apart in the first stand"
        yield SuitError("suit", problem, "Calibrate it in its own program, or stand straight")
    for i, name in enumerate(found.segments):
        number = int(found.tilts[:, i].argmax())
        if found.measured[i] and found.tilts[number, i] > thresholds.same:
            by = np.degrees(found.tilts[number, i])
            problem = f"in stand {number + 1} it is tilted by {by:.0f} degrees unlike at first"
            remedy = f"Take the same pose: r {number + 1}; if you did, its sensor has slipped"
            yield SuitError(name, problem, remedy)


def _drifting(found: Suit, pose: str, thresholds: Thresholds) -> Iterator[SuitError]:
    for i, name in enumerate(found.segments):
        rate, sure = PER_MINUTE * found.rates[i], PER_MINUTE * found.uncertain[i]
        if not found.measured[i]:
            continue
        drift_text = f"its heading drifts by {rate:+.1f} deg/min (standard deviation {sure:.1f})"
        if abs(rate) > thresholds.drift and abs(rate) > 2.0 * sure:
            remedy = "Let the sensors warm up, keep away from iron and motors, calibrate in the suit's own program"
            yield SuitError(name, f"{drift_text}, {thresholds.drift:g} are allowed", remedy)
        elif sure > thresholds.sure:
            remedy = "Take the same pose more exactly, feet on the marks, or walk longer: --option walk=120"
            yield SuitError(name, f"{drift_text}: the stands differ too much to tell", remedy)
