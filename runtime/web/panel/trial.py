"""A trial on the participant's screen, as data: what is shown, and what came of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc import private_file

SAMPLES: Final = ("t", "target", "value")
FRAMES: Final = ("t", "value", "age")
LIMIT: Final = 20_000
"""Samples of a curve, and s of a trial's parts, at most: what is sent to a page is bounded."""


@dataclass(frozen=True)
class Trial:
    """A curve to be followed.

    Attributes:
        curve: (k,) the target, 0..1, at k >= 2 equally spaced times from 0 to `duration`; linear between them.
        duration: s of the curve.
        settle: s before it in which the pointer is brought to the curve's first value.
        rest: s of a break before the trial can be begun.
        title: what the participant reads; number, of: which trial of how many it is.
    """

    curve: tuple[float, ...]
    duration: float = 25.0
    settle: float = 5.0
    rest: float = 0.0
    title: str = ""
    number: int = 1
    of: int = 1

    def __post_init__(self) -> None:
        """Raises ValueError: a value is out of its range."""
        curve = tuple(float(y) for y in self.curve)
        object.__setattr__(self, "curve", curve)
        if not 2 <= len(curve) <= LIMIT or not all(0.0 <= y <= 1.0 for y in curve):
            raise ValueError(f"a curve has 2 to {LIMIT} samples from 0 to 1")
        if not 0 < self.duration <= LIMIT or not all(0 <= s <= LIMIT for s in (self.settle, self.rest)):
            raise ValueError(f"a trial's times are from 0 to {LIMIT} s")
        if not 1 <= self.number <= self.of:
            raise ValueError("a trial's number is from 1 to how many there are")

    def target(self, t: Array) -> Array:
        """The curve at t (k,) s since its beginning; before and after it, its ends."""
        found: Array = np.interp(t, np.linspace(0.0, self.duration, len(self.curve)), self.curve)
        return found


@dataclass(frozen=True)
class ScreenTrial:
    """What came of a trial.

    Attributes:
        trial: what was shown.
        began: CLOCK_MONOTONIC s of the curve's beginning; 0 if the trial never got so far.
        samples: (m, 3) the loop's own rows since the curve's beginning: t s, target, value. These are what counts.
        frames: (n, 3) the page's frames from the settling on: t s since the curve's beginning, the value drawn (NaN:
            none), its age when it was drawn, s. t is the browser's own stamp of the frame.
        events: (t s since the curve's beginning, words): when the value was held, and when it followed again.
        aborted: why the trial doesn't count; empty if it does.
        round_trip: s, the least that a message took from the page and back; t of the frames is known to half of it.
        lost: number of rows that were overwritten before they were read.
    """

    trial: Trial
    began: float
    samples: Array
    frames: Array
    events: list[tuple[float, str]] = field(default_factory=list)
    aborted: str = ""
    round_trip: float = float("nan")
    lost: int = 0

    @property
    def timing(self) -> dict[str, float]:
        """The frames in figures: how many, their median and 99th percentile interval, the ages', and what was missed.

        `missed` is the share of the screen's own intervals (the median one) in which no frame was drawn.
        """
        if len(self.frames) < 2:
            return {"frames": float(len(self.frames))}
        interval = np.diff(self.frames[:, 0])
        usual = float(np.median(interval))
        slots = np.maximum(np.rint(interval / max(usual, 1e-6)), 1.0)
        found = {"frames": float(len(self.frames)), "interval_p50": usual}
        found["interval_p99"] = float(np.percentile(interval, 99))
        found["missed"] = float(1.0 - len(interval) / slots.sum())
        ages = self.frames[np.isfinite(self.frames[:, 2]), 2]
        if len(ages):
            found |= {"age_p50": float(np.median(ages)), "age_p99": float(np.percentile(ages, 99))}
        return found

    def save(self, path: Path) -> None:
        """Writes PATH.json, PATH-samples.parquet and PATH-frames.parquet; the JSON comes last, when the others stand.

        Raises OSError.
        """
        for name, columns, values in (("samples", SAMPLES, self.samples), ("frames", FRAMES, self.frames)):
            import pyarrow as pa
            import pyarrow.parquet as pq

            sink = pa.BufferOutputStream()
            pq.write_table(pa.table({c: values[:, i] for i, c in enumerate(columns)}), sink)
            private_file.replace(path.with_name(f"{path.name}-{name}.parquet"), sink.getvalue().to_pybytes())
        head = self.content | {"timing": self.timing}
        del head["samples"], head["frames"]
        private_file.replace(path.with_name(f"{path.name}.json"), json.dumps(head).encode())

    @property
    def content(self) -> dict[str, Any]:
        """What can be written as JSON, and read back by `of`."""
        arrays = {"samples": self.samples.tolist(), "frames": self.frames.tolist()}
        return {**vars(self), "trial": asdict(self.trial), **arrays}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> ScreenTrial:
        """Makes it from `content`."""
        arrays = {name: table(content[name]) for name in ("samples", "frames")}
        events = [(float(t), str(words)) for t, words in content["events"]]
        return cls(**{**content, "trial": Trial(**content["trial"]), "events": events, **arrays})


def table(rows: Sequence[Sequence[float]] | NDArray[np.float64]) -> Array:
    """Rows of three numbers as an array (k, 3)."""
    return np.asarray(rows, dtype=float).reshape(-1, 3)
