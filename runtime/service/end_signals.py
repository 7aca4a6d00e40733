"""The signals that end a run: from the beginning of `srl run` to its last instruction, none is lost."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
Handler = Callable[[int, FrameType | None], object] | int | None


class EndSignals:
    """Remembers a request to end, and passes it on.

    At the end of the block the run is over: what arrives later must not change the exit code, so the signals are
    ignored from then on. (Blocked ones could still reach another thread.) After an error they are as before.
    """

    def __init__(self) -> None:
        self._asked = False
        self._end: Callable[[], None] = lambda: None

    def pass_to(self, end: Callable[[], None]) -> None:
        """Calls `end` at each request from now on, and at once if there was one."""
        self._end = end
        if self._asked:
            end()

    def __enter__(self) -> EndSignals:
        self._before: dict[signal.Signals, Handler] = {n: signal.signal(n, self._ask) for n in SIGNALS}
        return self

    def __exit__(self, error: object, *_: object) -> None:
        if error is None:
            for number in SIGNALS:
                signal.signal(number, signal.SIG_IGN)
            return
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, *_: object) -> None:
        self._asked = True
        self._end()
