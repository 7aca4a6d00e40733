"""Rows on a fixed rate, for formats without time stamps: for each frame the newest row of its time, or none."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from srl.runtime.recording.reader import Recording


@dataclass(frozen=True)
class Grid:
    """Frames at a fixed rate.

    Attributes:
        rate: frames per second.
        rows: (k,) index of each frame's row.
        there: (k,) whether the frame has a row of its own: False in a gap, where `rows` is the one before it.
        skipped: number of rows that are no frame's.
    """

    rate: float
    rows: NDArray[np.intp]
    there: NDArray[np.bool_]
    skipped: int


def grid(recording: Recording, rate: Fraction | None = None) -> Grid:
    """The frames of a recording, at the loop's rate or at another one, Hz.

    A frame's row is the newest one that isn't later by more than half a period of the loop. It isn't there if the row
    is earlier than that by a frame's period.
    """
    loop = Fraction(*recording.layout.meta["rate"])
    wanted = float(loop if rate is None else rate)
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    slack, period = 0.5 / float(loop), 1.0 / wanted
    times = np.arange(int((now[-1] + slack) / period) + 1) * period
    rows = np.searchsorted(now, times + slack, "right") - 1
    there = times - now[rows] < max(period, 2 * slack) - 1e-9
    return Grid(wanted, rows, there, len(now) - len(np.unique(rows)))
