"""What a trial of the stop's latency counts as a failure."""

import os
import pty
import time
import tty
from collections.abc import Iterator

import pytest

from bench import stop_latency
from bench.pty_arm import STOP
from bench.stop_latency import TIMEOUT, Trial


@pytest.fixture
def trial() -> Iterator[Trial]:
    """A trial whose device is there and whose processes aren't."""
    made = Trial(0.0, supervisor=-1, loop=-1)
    made._master, made._slave = pty.openpty()
    tty.setraw(made._slave)
    yield made
    os.close(made._master)
    os.close(made._slave)
    made.folder.rmdir()


class Clock:
    """A clock that jumps at its third reading; at the sixth, `then` is called."""

    def __init__(self, jump: float, then: object = None) -> None:
        self.jump, self.then, self.readings = jump, then, 0

    def monotonic(self) -> float:
        self.readings += 1
        if self.readings == 6 and callable(self.then):
            self.then()
        return time.monotonic() + (self.jump if self.readings >= 3 else 0.0)

    monotonic_ns = staticmethod(time.monotonic_ns)


def test_a_host_that_stood_still_is_no_failure(trial: Trial, monkeypatch: pytest.MonkeyPatch) -> None:
    # Whoever runs first after it is this process, of the highest priority: the supervisor had no time at all.
    monkeypatch.setattr(stop_latency, "time", Clock(2 * TIMEOUT, lambda: os.write(trial._slave, STOP)))
    trial.until_stopped()
    assert trial.stop


def test_a_stop_that_never_comes_is_said_with_the_processes_states(
    trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop_latency, "TIMEOUT", 0.05)
    trial.supervisor = os.getpid()
    with pytest.raises(TimeoutError, match=r"supervisor R in .*, loop gone, 0 commands"):
        trial.until_stopped()
