"""What the guided calibration of surface EMG gave: rows of samples with marks.

A mark is 0 where nothing counts, 1 at rest, and 100 muscle + repeat (both from 1) in a contraction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pydantic import Field, model_validator

from srl.commissioning.calibration.emg.fit import Thresholds
from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw, stretches
from srl.control.emg.blocks import joined_samples
from srl.control.emg.processing import EmgError, Filters
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

REST: Final = 1
MUSCLES: Final = 16
REPEATS: Final = 9
_AGAIN: Final = "do it again: r N, or --redo N --from FILE.rrd"


def mark(muscle: int, repeat: int) -> int:
    """Of a contraction's samples; both count from 1."""
    return 100 * muscle + repeat


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Rows in the order of time.

    Attributes:
        times: (T,) s.
        blocks: (T, k, n) V, the newest k samples of n muscles in each row, oldest first; NaN where they weren't there.
        counts: (T,) how many samples there have been.
        marks: (T,).
    """

    times: Array
    blocks: Array
    counts: Array
    marks: Indices


class Plan(Options):
    """How often and how long, and how the signal is processed. Times and repeats as is usual (Konrad 2005)."""

    repeats: int = Field(3, ge=2, le=REPEATS, description="contractions of each muscle")
    read: float = Field(5.0, ge=0.5, le=60, description="s before the rest level is taken")
    rest: float = Field(5.0, ge=1.0, le=60, description="s at rest")
    hold: float = Field(3.0, ge=1.0, le=10, description="s of a contraction that count, from its onset")
    pause: float = Field(30.0, ge=1.0, le=300, description="s of rest before each contraction")
    patience: float = Field(10.0, ge=2.0, le=60, description="s after which a contraction without an onset ends")
    rate: float = Field(2000.0, gt=100, le=10000, description="Hz, of the device's samples")
    low: float = Field(20.0, gt=0, description="Hz, band-pass")
    high: float = Field(450.0, gt=0, description="Hz, band-pass")
    cutoff: float = Field(5.0, ge=2.5, le=20, description="Hz, of the envelope")
    window: float = Field(0.5, ge=0.1, le=1.0, description="s, over which a contraction's envelope is averaged")

    @model_validator(mode="after")
    def _fits(self) -> Plan:
        try:
            self.filters()
        except EmgError as error:
            raise ValueError(f"{error.problem}: {error.remedy}") from None
        return self

    def filters(self) -> Filters:
        """The filters. Raises EmgError: there are none of these numbers."""
        return Filters(self.rate, (self.low, self.high), cutoff=self.cutoff)


def parts(samples: Samples, muscles: Sequence[str], plan: Plan) -> tuple[Array, dict[tuple[int, int], Array]]:
    """The samples at rest (m, n) V, and those of each contraction, by muscle and repeat from 0.

    The last time that counts of each is taken. Raises EmgError: one isn't there, or samples are missing in it.
    """
    rest = _whole(samples, REST, plan.rest, plan.rate, "rest", 0)
    found = {
        (i, j): _whole(samples, mark(i + 1, j + 1), plan.hold, plan.rate, f"{name}, contraction {j + 1}", i + 1)
        for i, name in enumerate(muscles)
        for j in range(plan.repeats)
    }
    return rest, found


def _whole(samples: Samples, wanted: int, least: float, rate: float, place: str, number: int) -> Array:
    remedy = _AGAIN.replace("N", str(number), 2)
    missing = False
    for at in reversed(stretches(samples.marks, wanted)):
        times = samples.times[at]
        if times[-1] - times[0] < 0.9 * least:
            continue  # broken off
        if (whole := joined_samples(samples.blocks[at], samples.counts[at])) is None:
            missing = True
            continue
        came = len(whole) / (times[-1] - times[0])
        if not 0.9 * rate <= came <= 1.1 * rate:
            problem = f"{came:.0f} samples came in a second, {rate:g} are expected"
            raise EmgError(place, problem, "Correct --option rate, or look for what holds the samples up")
        return whole
    problem = "samples are missing in it" if missing else "it wasn't done to its end"
    raise EmgError(place, problem, f"See to the sensor's reach, and {remedy}" if missing else f"Do it: {remedy[15:]}")


class EmgMarksConfig(ControllerConfig):
    """Options of `emg-marks`."""

    person: str = Field(description="anonymous id")
    signal: str = Field(description="the device's newest samples")
    count: str = Field(description="how many there have been")
    channels: dict[str, int | str] = Field({}, description="the device's slot of each muscle")
    muscles: tuple[str, ...] = Field(min_length=1, max_length=MUSCLES, description="names of its columns, in order")
    plan: Plan = Plan()
    thresholds: Thresholds = Thresholds()


class EmgMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = EmgMarksConfig
    summary = "marks in the rows when surface EMG is calibrated (srl calibrate PROFILE emg)"
    most = mark(MUSCLES, REPEATS)
