"""What the guided calibration of a glove gave: the sensors' counts with marks.

A mark is 0 where nothing counts, and n while shape n is held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.glove.fit import GloveError, Held, Thresholds
from srl.commissioning.calibration.glove.shapes import LAST, Angles, shapes
from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw, stretches
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

_BLOCKS: Final = 5
_SHARE: Final = 0.8  # of a shape's samples that must be measured: a radio loses some


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        raw: (T, n) counts of all sensors; NaN where the glove wasn't there or wasn't fresh.
        marks: (T,).
    """

    times: Array
    raw: Array
    marks: Indices


class Plan(Options):
    """How long the steps take, and what isn't calibrated."""

    device: str = Field("", description="the glove; needed where the profile has several")
    average: str = Field(
        "palm_arch, wrist_pitch, wrist_yaw", description="sensors that stay those of an average hand, by name"
    )
    read: float = Field(
        4.0, ge=0.2, le=60, description="s for which the hand must be still before the first shape is taken"
    )
    settle: float = Field(1.0, ge=0.2, le=30, description="s of the same before each other")
    hold: float = Field(2.0, ge=0.5, le=60, description="s of a shape that count")

    @property
    def left(self) -> tuple[str, ...]:
        """The names in `average`."""
        return tuple(name.strip() for name in self.average.split(",") if name.strip())


def moved(raw: Array) -> float:
    """Counts: how far the means of consecutive blocks are apart at most, in any sensor.

    Infinite where too little is measured. Means are compared, so that noise doesn't look like motion.

    Args:
        raw: (T, n) counts; NaN where it isn't measured.
    """
    if len(raw) < _BLOCKS or not raw.shape[1]:
        return float("inf")
    there = np.isfinite(raw).all(axis=1)
    if there.mean() < _SHARE or not all(part.any() for part in np.array_split(there, _BLOCKS)):
        return float("inf")
    parts = zip(np.array_split(raw, _BLOCKS), np.array_split(there, _BLOCKS), strict=True)
    means = np.array([part[seen].mean(axis=0) for part, seen in parts])
    return float(np.ptp(means, axis=0).max())


def held(
    samples: Samples, own: Sequence[int], known: Angles, plan: Plan, thresholds: Thresholds
) -> dict[int, Held]:  # fmt: skip
    """What each shape that was held to its end gave, by number; the last time that counts.

    Args:
        samples: of a whole calibration.
        own: places of the sensors that are calibrated.
        known, plan, thresholds: of the calibration.
    Raises:
        GloveError: a shape isn't there, or wasn't still.
    """
    found: dict[int, Held] = {}
    for number, shape in shapes(known).items():
        place = f"shape {number} ({shape.name})"
        whole = [at for at in stretches(samples.marks, number) if _length(samples.times[at]) >= 0.9 * plan.hold]
        if not whole:
            remedy = f"Do it: r {number}, or --redo {number} --from FILE.rrd"
            raise GloveError(place, "it wasn't held to its end", remedy)
        parts = [samples.raw[at][:, list(own)] for at in whole]
        by = [moved(part) for part in parts]
        still = [part for part, far in zip(parts, by, strict=True) if far <= thresholds.steady]
        if not still:
            problem = f"the hand moved by {by[-1]:.0f} counts" if np.isfinite(by[-1]) else "some samples are missing"
            raise GloveError(place, problem, "Do it again, still: r N, or --redo N --from FILE.rrd")
        raw = still[-1][np.isfinite(still[-1]).all(axis=1)]
        found[number] = Held(raw.mean(axis=0), raw.std(axis=0), raw.min(axis=0), raw.max(axis=0), len(raw))
    return found


def _length(times: Array) -> float:
    return float(times[-1] - times[0]) if len(times) >= _BLOCKS else 0.0


class GloveMarksConfig(ControllerConfig):
    """Options of `glove-marks`."""

    person: str = Field(description="anonymous id")
    signal: str = Field(description="the glove's counts")
    hand: Literal["right", "left"] = Field(description="whose glove it is")
    sensors: tuple[str, ...] = Field(min_length=1, description="names of its elements, in their order")
    plan: Plan = Plan()
    angles: Angles = Angles()
    thresholds: Thresholds = Thresholds()

    @property
    def own(self) -> tuple[int, ...]:
        """The places of the sensors that are calibrated."""
        return tuple(i for i, name in enumerate(self.sensors) if name not in self.plan.left)


class GloveMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = GloveMarksConfig
    summary = "marks in the rows when a data glove is calibrated (srl calibrate PROFILE glove)"
    most = LAST
