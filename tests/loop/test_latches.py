"""A stop lasts: a client of the bus that asks for motion at full speed never gets it after a person's stop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.toy import Bench

from runtime.ipc.requests import RequestKind, RequestWriter
from runtime.ipc.words import State

MOVING = (State.HOMING, State.ACTIVE)


def insist(b: Bench, script: Callable[[int], None] = lambda k: None) -> Callable[[int], None]:
    """A script with a client that sends a reset and a start before every cycle."""
    ring = RequestWriter(b.run_folder.requests)

    def each(k: int) -> None:
        b.hand.values["position"][:] = np.sin(k / 20)
        script(k)
        for kind in (RequestKind.RESET, RequestKind.START):
            ring.send(kind, expires=1 << 62)

    return each


def states(b: Bench) -> list[State]:
    return [state for state, _ in b.states]


def test_a_persons_stop_lasts(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="")
    b.run(200, insist(b, lambda k: b.ask("stop") if k == 50 else None))
    assert states(b)[40] is State.ACTIVE
    assert not set(states(b)[52:]) & set(MOVING)


@pytest.mark.parametrize("first", ["stop of a client", "fault"])
def test_a_persons_stop_lasts_whatever_stopped_the_limb_before(tmp_path: Path, first: str) -> None:
    b = Bench(tmp_path, emergency="")
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        if k == 50 and first == "fault":
            b.arm.health.fault = "protective stop"
        elif k == 50:
            client.send(RequestKind.STOP, 1 << 62)
        if k == 80:
            b.arm.health.fault = ""
            b.ask("stop")
        if k >= 100:
            client.send(RequestKind.RESET, 1 << 62)

    b.run(200, script)
    assert states(b)[79] is State.STOPPED
    assert not set(states(b)[80:]) & set(MOVING)
