"""A guard and what computes its ordinary cycles: each is asked where it may be, and gives its state back before."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.contracts.signals import Array, Command, Kind, Stop
from srl.runtime.guard import GUARDS, CommandGuard, GuardLimits
from srl.runtime.guard.fast import Fast

DT = 0.01


class Noted(Fast):
    """Answers as the test sets it, and records what it was asked."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.done, self.all_taken = 0, True

    def step(self, desired: Array, desired_velocity: Array | None, dt: float) -> int:
        self.asked.append("step")
        return self.done

    def taken(self, transmitted: bool, dt: float) -> bool:
        self.asked.append("taken")
        return self.all_taken

    def leave(self) -> None:
        self.asked.append("leave")

    def tell(self) -> None:
        self.asked.append("tell")

    def forget(self) -> None:
        self.asked.append("forget")


class Bench:
    """A guard of one position with `Noted`, after its reset."""

    def __init__(self, kind: Kind = Kind.POSITION) -> None:
        limits = GuardLimits(velocity=1.0, acceleration=10.0, effort=20.0, effort_rate=50.0, inertia=1.0)
        command = Command(name="c", shape=(1,), unit="1", kind=kind, period=0.02)
        self.guard: CommandGuard = GUARDS[kind]("guard.c", command, limits.to_limits((1,), "guard.c"), DT)
        self.applied, self.sent, self.gravity = np.zeros(1), np.full(1, np.nan), np.zeros(1)
        self.guard.bind(self.applied, np.zeros(1), np.zeros(1), self.sent, self.gravity)
        self.fast = Noted()
        self.guard.reset(np.zeros(1))
        self.guard.fast = self.fast

    def taken(self) -> list[str]:
        asked, self.fast.asked = self.fast.asked, []
        return asked


@pytest.mark.parametrize(("done", "limited"), [(0, False), (1, True)])
def test_what_it_has_done_is_not_done_again(done: int, limited: bool) -> None:
    b = Bench()
    b.fast.done = done
    for k in range(1, 4):
        b.guard.step(np.ones(1), None, DT)
        assert b.taken() == ["step"]
        assert b.guard.limited == limited
        assert b.guard.limitations == limited * k
        assert b.applied[0] == 0.0


def test_what_it_leaves_is_done_here() -> None:
    b = Bench()
    b.fast.done = -1
    b.guard.step(np.ones(1), None, DT)
    assert b.taken() == ["step", "leave"]
    assert b.guard.limited
    assert b.applied[0] > 0.0


def test_with_old_measurements_it_is_not_asked() -> None:
    b = Bench()
    b.guard.unmeasured = True
    b.guard.step(np.ones(1), None, DT)
    assert b.taken() == ["leave"]
    assert b.applied[0] > 0.0


def test_before_a_stop_it_gives_the_state_back() -> None:
    b = Bench()
    b.guard.stop(Stop.HOLD, DT)
    assert b.taken() == ["leave"]


def test_what_was_all_taken_is_not_compared_and_what_was_not_is() -> None:
    b = Bench()
    b.sent[:] = 1e6
    b.guard.resynchronise(True, DT)
    assert b.taken() == ["taken"]
    assert not b.guard.resynchronised
    b.fast.all_taken = False
    b.sent[:] = 0.0
    b.guard.resynchronise(True, DT)
    assert b.taken() == ["taken"]
    b.applied[:] = 0.5
    b.guard.resynchronise(True, DT)  # it may be sent in the next read
    assert b.taken() == ["taken"]
    b.guard.resynchronise(True, DT)
    assert b.taken() == ["taken", "leave"]
    assert b.guard.resynchronised
    assert b.applied[0] == 0.0


def test_at_a_reset_it_forgets_and_for_what_was_sent_last_it_tells() -> None:
    b = Bench()
    b.guard.reset(np.zeros(1))
    assert b.taken() == ["forget"]
    b.sent[:] = 0.0
    assert b.guard.last_sent().tolist() == [0.0]
    assert b.taken() == ["tell"]


@pytest.mark.parametrize("stopped", [False, True])
def test_after_a_reset_no_stop_goes_on(stopped: bool) -> None:
    """In a stop of a torque what a device sends isn't taken up; after it, it is."""
    b = Bench(Kind.TORQUE)
    b.guard.fast = None
    b.gravity[:] = 3.0
    b.guard.reset(np.zeros(1))
    if stopped:
        b.guard.stop(Stop.HOLD, DT)
        b.guard.reset(np.zeros(1))
    assert b.applied[0] == 3.0
    b.sent[:] = 0.0
    b.guard.resynchronise(True, DT)
    assert b.applied[0] == 0.0
