"""Leads a person, or the simulated wearer, through the procedure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from srl.commissioning.calibration.guided import Procedure, Step
from srl.commissioning.calibration.screen import Screen
from srl.commissioning.calibration.sources import Rows, RowSource
from srl.runtime.contracts.errors import SrlError


class QuitError(SrlError):
    """The person ended the calibration."""


class Guide:
    """Feeds the procedure with a source's rows and the person's keys.

    Attributes:
        samples: all of them so far, in the method's own kind.
        first: the first rows that came.
    """

    def __init__(self, source: RowSource, procedure: Procedure, screen: Screen, stop: Callable[[], bool]) -> None:
        """`stop`: whether a signal asks for the end."""
        self._source, self._procedure, self._screen, self._stop = source, procedure, screen, stop
        self.samples: list[Any] = []
        self.first: Rows | None = None
        self._step: Step | None = None
        self._typed: deque[str] = deque()
        self._newest: float | None = None  # s, time of the newest row
        self._clock = 0.0  # s, of the procedure

    def run(self) -> None:
        """Goes on until the procedure is done. Raises QuitError, CalibrationError, and what the source raises."""
        procedure = self._procedure
        while True:
            if procedure.step is not self._step:
                self._step = procedure.step
                self._source.begin(procedure)
            # The last trial ends where its mark does, a few rows later: so it is in the recording.
            if procedure.done and self._mark() == procedure.step.mark:
                return
            self._look(procedure.step.mark)
            rows = self._source.take()
            if len(rows):
                if self.first is None:
                    self.first = rows
                self.samples.append(self._source.channel_map.samples(rows))
                self._feed(rows, self.samples[-1])
            self._screen.show(procedure.view())

    def _feed(self, rows: Rows, samples: Any) -> None:
        """Feeds the procedure on a clock that stands while the run is stopped: no step ends meanwhile."""
        channel_map = self._source.channel_map
        times, active = channel_map.times(rows), channel_map.active(rows)
        steps = np.diff(times, prepend=times[0] if self._newest is None else self._newest)
        self._newest = times[-1]
        clock = self._clock + np.where(active, steps, 0.0).cumsum()
        self._clock = clock[-1]
        self._procedure.feed(replace(samples, times=clock[active]))

    def _mark(self) -> int:
        """Of the newest sample; -1 before the first."""
        return next((int(part.marks[-1]) for part in reversed(self.samples) if len(part)), -1)

    def _look(self, mark: int) -> None:
        """Does what was typed, once rows bear the step's mark: none may be passed over, or they would say less."""
        typed = self._screen.command()
        if self._stop() or typed == "q":
            raise QuitError("calibration", "it was ended before it was complete", "Nothing was written; begin again")
        if typed != "none":
            self._typed.append(typed)
        if not self._typed or self._mark() != mark:
            return
        typed = self._typed.popleft()
        word, _, number = typed.partition(" ")
        if typed == "":
            answer = self._procedure.go_on()
        elif typed == "s":
            answer = self._procedure.skip()
        elif word == "r" and number.strip().isdigit():
            answer = self._procedure.redo(int(number))
        else:
            answer = f"'{typed}' is no command"
        if answer:
            self._screen.say(answer)
