"""The checks of a recording's numbers that all readers share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array

MAX_STEP = 5.0  # s between samples: a motion isn't recorded so slowly
FARTHEST = 1e9  # in any unit here
MAX_RATE = 10_000.0  # Hz; a "time" column with a higher rate isn't in seconds


def check_samples(path: Path, time: Array, values: Array, names: list[str], first_line: int) -> None:
    """Raises an error for samples that can't be played.

    Args:
        path: the file, for the error.
        time: (n,), s.
        values: (n, m).
        names: names of the m columns.
        first_line: line (or sample) number of the first sample, for the error.
    Raises:
        RecordingError: fewer than two samples, a value that isn't finite, a time that doesn't increase.
    """
    if len(time) < 2:
        raise RecordingError(str(path), f"it has {len(time)} sample(s)", "A motion needs two at least")
    columns = np.column_stack([time, values])
    bad = np.argwhere(~np.isfinite(columns))
    if bad.size:
        row, column = bad[0]
        name = (["time", *names])[column]
        raise RecordingError(
            f"{path}, line {first_line + row}, column '{name}'",
            "the value is missing or not a finite number",
            "Cut the line out or fill the gap; gaps are not guessed",
        )
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise RecordingError(
            f"{path}, line {first_line + row}, column 'time'",
            f"the time {time[row]:g} doesn't come after {time[row - 1]:g}",
            "Sort the samples by time and drop repeated ones",
        )
    if (step := float(np.median(steps))) >= MAX_STEP:
        raise RecordingError(
            str(path), f"samples are {step:g} s apart: are these milliseconds?",
            "Give the time in seconds, or name the column time_ms",
        )  # fmt: skip
    if np.abs(columns).max() > FARTHEST:
        row, column = np.unravel_index(int(np.abs(columns).argmax()), columns.shape)
        name = (["time", *names])[column]
        raise RecordingError(
            f"{path}, line {first_line + row}, column '{name}'", f"{columns[row, column]:g} can't be", "Correct it"
        )
    if step < 1.0 / MAX_RATE:
        raise RecordingError(str(path), "samples come faster than 10 kHz", "Give the time in seconds")
