"""The control value as the loop's rows have it, and whether it can be believed. It only reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.rows import Condition, Rows
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.profile.plots import pick


@dataclass(frozen=True)
class Reading:
    """What the newest row says.

    Attributes:
        stamp: CLOCK_MONOTONIC s at which the value was known: the end of the cycle's laws. 0: there was no row.
        value: the signal mapped to 0..1, not clamped; NaN if there is none.
        condition: whether it follows the participant now.
        words: the condition for people; empty if it is live.
        generation: grows by one with each new run of the loop.
    """

    stamp: float
    value: float
    condition: Condition
    words: str
    generation: int


class Source:
    """Follows a signal through the rows of an instance, also when its loop is started again."""

    def __init__(
        self, run_folder: RunFolder, signal: str, span: tuple[float, float] = (0.0, 1.0), held: str | None = None
    ) -> None:
        """Opens the rows.

        Args:
            run_folder: the instance's folder.
            signal: one number of the row: "ikns.c", "ikns.c[swivel]".
            span: values of the signal that are shown as 0 and 1, in its unit.
            held: a signal that isn't zero, in any element, while the value is held ("arm.held").
        Raises:
            RecordingError: there is no run here, or its rows lack the signal.
        """
        self._signal, self._held = signal, held
        self._low, self._high = span
        self._rows = Rows(run_folder, self._fits)

    def take(self, now: float) -> tuple[Array, Reading]:
        """Returns the new rows' times and values, shape (k, 2) (CLOCK_MONOTONIC s, 0..1), and the newest reading.

        Args:
            now: CLOCK_MONOTONIC s.
        """
        rows = self._rows.take(now)
        return self._values(self._rows.layout, rows), self._reading(now)

    @property
    def lost(self) -> int:
        """Number of rows that were overwritten before they were read."""
        return self._rows.lost

    def close(self) -> None:
        """Unmaps the rows."""
        self._rows.close()

    def _fits(self, layout: Layout) -> None:
        self._values(layout, np.zeros((1, layout.width), np.int64))

    def _values(self, layout: Layout, rows: Words) -> Array:
        place = "the participant's screen"
        values = pick(layout, rows, self._signal, place)
        if values.ndim != 1:
            problem = f"'{self._signal}' has {int(np.prod(values.shape[1:]))} numbers, and one is shown"
            raise RecordingError(place, problem, f"Say which, for example '{self._signal}[NAME]'")
        if self._held is not None:
            pick(layout, rows[:0], self._held, place)
        times = layout.header(rows, "control") / 1e9
        return np.column_stack([times, (values - self._low) / (self._high - self._low)])

    def _reading(self, now: float) -> Reading:
        row, layout = self._rows.last, self._rows.layout
        condition, words = self._rows.condition(now)
        value = float("nan")
        if row is not None:
            value = float(self._values(layout, row[None])[0, 1])
            held = self._held is not None and bool(np.any(pick(layout, row[None], self._held, self._held)))
            if condition is Condition.HELD:
                words += ": the value is held"
            elif condition is Condition.LIVE and not np.isfinite(value):
                condition, words = Condition.HELD, "There is no value"
            elif condition is Condition.LIVE and held:
                condition, words = Condition.HELD, "You can't be seen: the value is held"
        return Reading(self._rows.stamp, value, condition, words, self._rows.generation)
