"""What happens on the participant's screen, one trial after the other. No I/O and no clock: times are given.

idle -> (a trial is offered) waiting -> (the participant begins) running -> (its time is over, or something is wrong)
idle. Settling is the part of `running` before the curve's beginning.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from typing import Any

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.rows import Condition
from srl.runtime.web.panel.source import Reading
from srl.runtime.web.panel.trial import ScreenTrial, Trial, table

LEAD = 0.1  # s from the key to the settling's beginning, so that the page knows it in time
GRACE = 1.0  # s of silence that a trial bears
LATE = 1.0  # s after a trial's end during which the page's last frames may come
FASTEST = 500  # frames a second of a page, at most


class Phase(StrEnum):
    """What the screen shows."""

    IDLE = "idle"
    WAITING = "waiting"
    RUNNING = "running"


class Session:
    """The trials of one screen.

    Attributes:
        phase: what the screen shows.
        trial: the trial that is waiting or running.
        began: CLOCK_MONOTONIC s of its curve's beginning, once it runs.
        last_outcome: how the last trial ended, for the participant.
        changed: called after each change of these.
        ended: called with each trial's outcome.
    """

    phase: Phase
    trial: Trial | None
    began: float
    _rows: list[Array]
    _frames: list[list[float]]
    _events: list[tuple[float, str]]
    _reading: Reading | None
    _words: str

    def __init__(self) -> None:
        self.last_outcome = ""
        self.changed: Callable[[], None] = lambda: None
        self.ended: Callable[[ScreenTrial], None] = lambda _: None
        self._clear()

    def offer(self, trial: Trial, now: float) -> None:
        """Lets the participant begin a trial. One that is waiting or running is aborted."""
        if self.trial is not None:
            self.abort("another trial was set in its place", now)
        self._clear()
        self.trial, self.phase = trial, Phase.WAITING
        self._rested = now + trial.rest
        self.changed()

    def begin(self, now: float) -> str:
        """The participant begins the trial. Returns why not; empty if it begins."""
        if self.phase is not Phase.WAITING or self.trial is None:
            return "There is no trial to begin"
        if self._reading is None or self._reading.condition is not Condition.LIVE:
            return "A trial can begin once the pointer follows you"
        if now < self._rested:
            return "The break isn't over"
        self.began = now + LEAD + self.trial.settle
        self._generation = self._reading.generation
        self.phase = Phase.RUNNING
        self.changed()
        return ""

    def abort(self, why: str, now: float) -> None:
        """Ends a trial that is waiting or running; it can be repeated."""
        if self.phase is not Phase.IDLE:
            self._end(why, now)

    def frames(self, rows: list[list[float]], final: bool, round_trip: float) -> str:
        """Takes frames of the page: CLOCK_MONOTONIC s, value, age s. Returns what is wrong with them; empty if nothing.

        Args:
            rows: each three numbers; NaN where nothing was drawn.
            final: whether these are the trial's last.
            round_trip: s, the least so far.
        """
        if self.phase is not Phase.RUNNING or self.trial is None:
            return ""  # they come late, after an abort
        span = self.trial.settle + self.trial.duration + LEAD + LATE
        if len(self._frames) + len(rows) > FASTEST * span:
            return "more frames than a screen can show"
        self._frames += rows
        self._final |= final
        self._round_trip = round_trip
        return ""

    def tick(self, rows: Array, reading: Reading, lost: int, now: float) -> None:
        """Takes the loop's new rows (k, 2) (CLOCK_MONOTONIC s, value) and lets time pass. `lost`: rows lost so far."""
        self._reading = reading
        if self.phase is not Phase.RUNNING or self.trial is None:
            self._lost_before = lost
            return
        self._lost = lost - self._lost_before
        t = rows[:, 0] - self.began
        within = (t >= 0) & (t <= self.trial.duration)
        self._rows.append(np.column_stack([t, self.trial.target(t), rows[:, 1]])[within])
        if reading.words != self._words:
            self._words = reading.words
            self._events.append((now - self.began, reading.words or "The pointer follows again"))
        over = now - self.began - self.trial.duration
        if over >= 0 and (self._final or over > LATE):
            self._end("", now)
        elif over < 0 and (why := self._broken(reading, now)):
            self._end(why, now)

    def _broken(self, reading: Reading, now: float) -> str:
        if reading.generation != self._generation:
            return "the loop was started again"
        if reading.condition in (Condition.ENDED, Condition.STOPPED):
            return reading.words
        if reading.condition is Condition.SILENT and now - reading.stamp > GRACE:
            return reading.words
        return ""

    def _end(self, why: str, now: float) -> None:
        assert self.trial is not None
        trial, began = self.trial, self.began
        frames = table(self._frames)
        frames[:, 0] -= began
        samples = np.concatenate([np.empty((0, 3)), *self._rows])
        lost = max(self._lost, 0)
        outcome = ScreenTrial(trial, began, samples, frames, self._events, why, self._round_trip, lost)
        self.last_outcome = f"The trial was broken off: {why[0].lower()}{why[1:]}" if why else ""
        self._clear()
        self.changed()
        self.ended(outcome)

    def _clear(self) -> None:
        self.phase, self.trial, self.began = Phase.IDLE, None, 0.0
        self._rows, self._frames, self._events, self._reading = [], [], [], None
        self._final, self._round_trip, self._words = False, math.nan, ""
        self._rested, self._generation = 0.0, 0
        self._lost = self._lost_before = 0

    def state(self) -> dict[str, Any]:
        """What a page needs to show: phase, trial, times in ms on CLOCK_MONOTONIC."""
        trial = None
        if self.trial is not None:
            trial = {**vars(self.trial), "rested": self._rested * 1e3}
        return {"phase": self.phase, "trial": trial, "began": self.began * 1e3, "told": self.last_outcome}
