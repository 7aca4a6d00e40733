"""An exit waits for the limb to be at rest, and no longer than a stop may take: then the run ends without rest."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.toy import PERIOD, Bench

from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc.header import State
from srl.runtime.loop.cycle import TIMEOUT

MOST = TIMEOUT // PERIOD  # cycles
ASKED = 30


@pytest.fixture
def restless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A run whose limb never comes to rest: something keeps pushing it, say."""
    b = Bench(tmp_path)
    (guard,) = b.cycle.guards
    brake = guard.stop

    def stop(category: Stop, dt: float) -> None:
        brake(category, dt)
        guard.at_rest = guard.at_rest and b.cycle.machine.state is State.HOMING

    monkeypatch.setattr(guard, "stop", stop)
    return b


def test_a_limb_that_never_rests_does_not_keep_the_run_from_its_end(restless: Bench) -> None:
    restless.run(ASKED + MOST + 50, lambda k: restless.ask("exit", cause="bus_loss") if k == ASKED else None)
    states = [state for state, _ in restless.states]
    assert states[ASKED] == State.ACTIVE
    assert set(states[ASKED + 1 :]) == {State.STOPPING}, "it brakes until the end"
    assert MOST - 2 <= len(states) - ASKED <= MOST + 2, "that is when it ends, neither before nor later"


def test_the_time_before_the_exit_does_not_count(restless: Bench) -> None:
    asked = ASKED + MOST + 100

    def script(k: int) -> None:
        if k == ASKED:
            restless.ask("stop")
        if k == asked:
            restless.ask("exit", cause="bus_loss")

    restless.run(asked + MOST + 50, script)
    states = [state for state, _ in restless.states]
    assert set(states[ASKED + 1 :]) == {State.STOPPING}, "without an exit it stops as long as it takes"
    assert MOST - 2 <= len(states) - asked <= MOST + 2


def test_a_limb_at_rest_is_not_waited_for(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(ASKED + MOST, lambda k: b.ask("exit", cause="bus_loss") if k == ASKED else None)
    assert len(b.states) - ASKED < 50
