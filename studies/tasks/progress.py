"""How far a study's trials are: a bar with the time left on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any, Final, Self

_PAUSE: Final = 10.0  # s between two lines


class Progress:
    """Shown on standard error, as standard output is for results. Used by `with`."""

    def __init__(self, study: str, there: int, total: int) -> None:
        """`there`: of the `total`, those that were there before; they don't count for the time left."""
        self._study, self._there, self._done, self._total = study, there, there, total
        self._failed = 0
        self._begin = self._reported = time.monotonic()
        self._bar: Any = None

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bar

            text = TextColumn("[progress.description]{task.description}")
            end = TextColumn("{task.fields[end]}")
            self._bar = Bar(
                text, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), end, console=Console(stderr=True)
            )
            self._task = self._bar.add_task(self._study, total=self._total, completed=self._there, end="")
            self._bar.start()
        else:
            self.say(self._line())
        return self

    def advance(self, done: int, failed: int) -> None:
        """`done` more trials are there, `failed` of them without values."""
        self._done += done
        self._failed += failed
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done, end=self._end())
        elif time.monotonic() - self._reported > _PAUSE or self._done == self._total:
            self.say(self._line())

    def say(self, line: str) -> None:
        """Shows a line, above the bar if there is one."""
        if self._bar is not None:
            self._bar.console.print(line, markup=False, highlight=False)
        else:
            self._reported = time.monotonic()
            print(line, file=sys.stderr, flush=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def _line(self) -> str:
        end = self._end()
        return f"{self._study}: {self._done} of {self._total} trials" + (f", {end}" if end else "")

    def _end(self) -> str:
        words = [f"{self._failed} failed"] if self._failed else []
        if self._there < self._done < self._total:
            each = (time.monotonic() - self._begin) / (self._done - self._there)
            words.append(f"{_span(each * (self._total - self._done))} left")
        return ", ".join(words)


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
