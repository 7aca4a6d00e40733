"""A process that the supervisor started: from its first instruction it remembers that it is to end.

The supervisor starts it with the signals blocked (`starting`), so none can kill it before it has its handlers.
It makes its `Ending` first of all, before its heavy imports.
"""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager

FINAL = 2  # exit code of a child whose work is incomplete, where another attempt would change nothing
PARENT = "SRL_SUPERVISOR"  # environment: the supervisor's process id
SIGNALS = (signal.SIGTERM, signal.SIGINT)
_PR_SET_PDEATHSIG = 1


def end_with_parent(by: signal.Signals) -> None:
    """From now on the kernel sends this process a signal when its parent dies, in whatever way.

    Args:
        by: the signal.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(by), 0, 0, 0)


@contextmanager
def starting() -> Iterator[None]:
    """The supervisor's side: a process that is started meanwhile has its signals blocked until its `Ending`."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Ending:
    """Whether this process is to end: by SIGTERM, or because its supervisor has died (the kernel sends SIGTERM then).

    Attributes:
        asked: True from the first request on.
        orphan: True if the supervisor had died before this process could ask the kernel to tell it.
        on_ask: called at each request, in the main thread, between two instructions.
    """

    def __init__(self, interrupt: bool = False) -> None:
        """`interrupt`: whether SIGINT asks as well. If not it is ignored: Ctrl-C is for the supervisor."""
        self.asked = False
        self.on_ask: Callable[[], None] = lambda: None
        signal.signal(signal.SIGTERM, self._ask)
        signal.signal(signal.SIGINT, self._ask if interrupt else signal.SIG_IGN)
        end_with_parent(signal.SIGTERM)
        parent = os.environ.get(PARENT)
        self.orphan = parent is not None and os.getppid() != int(parent)
        self.asked = self.orphan
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)

    def _ask(self, *_: object) -> None:
        self.asked = True
        self.on_ask()
