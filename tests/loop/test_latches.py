"""A stop lasts: a client of the bus that asks for motion at full speed never gets it while a latch stands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.toy import Bench, _load

from srl.runtime.contracts import registry
from srl.runtime.ipc.header import CYCLE, Cause, Latch, Origin, State
from srl.runtime.ipc.latches import NONE, of_names
from srl.runtime.ipc.requests import Answer, RequestKind, RequestWriter
from srl.runtime.loop.replay import replay

MOVING = (State.HOMING, State.ACTIVE)
EVER = 1 << 62  # ns: never expires
MINUTE = 6000  # cycles
DECIDED = ("state", "latches", "refused", "request_kind", "request_result", "request_origin")


def insist(b: Bench, script: Callable[[int], None] = lambda k: None) -> Callable[[int], None]:
    """A script with a client that sends a reset and a start before every cycle."""
    ring = RequestWriter(b.run_folder.requests)

    def each(k: int) -> None:
        b.hand.values["position"][:] = np.sin(k / 20)
        script(k)
        for kind in (RequestKind.RESET, RequestKind.START):
            ring.send(kind, EVER)

    return each


def states(b: Bench) -> list[State]:
    return [state for state, _ in b.states]


def assert_replays(b: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows replay the same; with any of the new words changed in one row, or other latches at the start, not."""
    monkeypatch.setattr(registry, "load", _load)
    layout, rows = b.graph.layout, b.rows()[:-1]
    assert replay(layout, rows, "toy").identical
    for word in ("latches", "request_origin"):
        changed = rows.copy()
        changed[len(rows) // 2 :, getattr(CYCLE, word)] ^= 2
        assert replay(layout, changed, "toy").states_differ > 0
    layout.meta["latches"] = [] if layout.meta["latches"] else ["person"]
    assert replay(layout, rows, "toy").states_differ > 0


@pytest.mark.slow
@pytest.mark.parametrize("what", ["local stop", "e-stop", "fault", "restart"])
def test_for_a_minute_no_client_at_full_speed_moves_the_limb(tmp_path: Path, what: str) -> None:
    b = Bench(tmp_path, latched=Latch.RESTART if what == "restart" else NONE)

    def script(k: int) -> None:
        if k == 50 and what == "local stop":
            b.ask("stop")
        b.panel.values["buttons"][1] = k == 50 and what == "e-stop"
        if k in (50, 51):
            b.arm.health.fault = "protective stop" if k == 50 and what == "fault" else ""

    b.run(MINUTE, insist(b, script))
    started = 52
    assert what == "restart" or states(b)[40] is State.ACTIVE
    assert not set(states(b)[started:]) & set(MOVING)
    where = b.graph.layout.value(b.rows(), "arm.command.applied")  # the newest 4096 rows
    assert np.ptp(where, axis=0).max() == 0
    assert len(b.arm.sent) <= started or not np.ptp(b.arm.sent[100:], axis=0).any()
    latch = {"local stop": "person", "e-stop": "emergency"}.get(what, what)
    rows = b.rows()
    assert b.graph.layout.header(rows, "latches")[-2] == of_names([latch])
    # Every request that came is in the recording: those that took a cycle, and those for which there was no room.
    refused = b.graph.layout.header(rows, "refused")
    assert refused[-1] - refused[-1001] == 2 * 1000
    taken = rows[-1000:, [CYCLE.request_origin, CYCLE.request_result]]
    assert set(taken[:, 0]) == {Origin.BUS}
    assert set(taken[:, 1]) == {Answer.REFUSED_LATCH, Answer.REFUSED_RATE}
    seconds = [event for event in b.events if event.startswith("refused")]
    assert MINUTE / 100 - 5 <= len(seconds) <= MINUTE / 100 + 1
    assert b.arm.recoveries == 0  # nor does it have a device recover


@pytest.mark.parametrize("first", ["stop of a client", "fault", "local stop", "exit"])
def test_a_persons_stop_latches_whatever_stopped_the_limb_before(tmp_path: Path, first: str) -> None:
    b = Bench(tmp_path, emergency="", automatic=first != "exit")
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        if k == 50 and first == "fault":
            b.arm.health.fault = "protective stop"
        elif k == 50 and first == "stop of a client":
            client.send(RequestKind.STOP, EVER)
        elif k in (50, 80) and first != "exit":
            b.ask("stop")
        if k == 80:
            b.arm.health.fault = ""
            b.ask("stop")  # with "exit": while ready
        if k >= 100:
            client.send(RequestKind.RESET, EVER)

    b.run(200, script)
    assert states(b)[82] is State.STOPPED
    assert not set(states(b)[82:]) & set(MOVING)
    assert b.header("latches")[-2] & Latch.PERSON


@pytest.mark.parametrize("granted", [True, False])
def test_the_profile_says_whether_the_bus_may_end_a_faults_stop(tmp_path: Path, granted: bool) -> None:
    b = Bench(tmp_path, emergency="", more="reset: {bus: [bus, fault]}" if granted else "")
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        b.hand.silent = 50 <= k < 60
        if k in (80, 120):
            client.send(RequestKind.RESET, EVER)
        if k == 100:
            client.send(RequestKind.STOP, EVER)

    b.run(140, script)
    assert b.header("latches")[79] == Latch.FAULT
    assert (states(b)[90] is State.ACTIVE) == granted
    assert b.header("latches")[110] == (Latch.BUS if granted else Latch.BUS | Latch.FAULT)
    assert (states(b)[130] is State.ACTIVE) == granted


def test_a_local_reset_releases_every_latch(tmp_path: Path) -> None:
    b = Bench(tmp_path, latched=Latch.RESTART | Latch.PERSON | Latch.BUS)
    b.run(60, lambda k: b.ask("reset") if k == 20 else None)
    assert states(b)[19] is State.STOPPED
    assert states(b)[-1] is State.ACTIVE
    assert b.header("latches")[-2] == 0
    assert any(event.startswith("reset (local, user ") for event in b.events)


def test_an_actuator_whose_power_is_cut_during_a_clients_stop_latches(tmp_path: Path) -> None:
    """A hardware stop that a person presses while a client has stopped the limb: its release moves nothing."""
    b = Bench(tmp_path, emergency="", latched=Latch.BUS)
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        b.arm.silent = k < 5 or 50 <= k < 60  # it starts as slowly as any, which latches nothing
        if k in (40, 80):
            client.send(RequestKind.RESET if k == 80 else RequestKind.STOP, EVER)

    b.run(100, script)
    assert b.header("latches")[45] == Latch.BUS
    assert b.header("latches")[-2] == Latch.BUS | Latch.FAULT
    assert not set(states(b)) & set(MOVING)


def test_a_reset_that_waits_while_an_emergency_comes_and_goes_is_refused(tmp_path: Path) -> None:
    """One request is taken in a cycle: what waited behind others came before the person pressed."""
    b = Bench(tmp_path, emergency="{signal: panel.buttons, element: second}", latched=Latch.PERSON)

    def script(k: int) -> None:
        b.panel.values["buttons"][1] = k == 50
        if k == 50:
            b.ask("start")  # refused, but it takes the cycle
            b.ask("reset")

    b.run(80, script)
    assert not set(states(b)) & set(MOVING)
    assert b.header("latches")[-2] == Latch.PERSON | Latch.EMERGENCY


def test_a_silent_client_hides_no_emergency_input_that_is_away(tmp_path: Path) -> None:
    """A client's silence doesn't block a reset. The unplugged e-stop beside it does."""
    b = Bench(tmp_path, emergency="{signal: panel.buttons, element: second}", client=True)
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        if k < 50:
            client.send(RequestKind.SETPOINT, EVER, 0, np.zeros(2))
        b.panel.silent = k >= 60
        if k == 80:
            b.ask("reset")

    b.run(100, script)
    assert states(b)[55] is State.ACTIVE
    assert not set(states(b)[70:]) & set(MOVING)
    assert b.header("request_result")[80] == Answer.REFUSED_FAULT


def test_after_a_reset_the_limb_waits_for_a_new_setpoint(tmp_path: Path) -> None:
    """A client that was silent may have gone: what it asked for before moves nothing after the reset."""
    b = Bench(tmp_path, emergency="", client=True)
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        if k < 30 or k >= 150:
            client.send(RequestKind.SETPOINT, EVER, 0, np.full(2, 1.5))
        if k == 80:
            b.ask("reset")

    b.run(200, script)
    sent = np.array(b.arm.sent)[:, 0]
    assert states(b)[29] is State.ACTIVE
    assert b.states[79] == (State.STOPPED, Cause.INTENT_LOSS)
    assert set(states(b)[90:]) == {State.ACTIVE}
    assert np.ptp(sent[60:148]) == 0
    assert 0 < sent[60] < 1.0
    assert sent[199] > sent[150] + 0.1, "and follows it"


def test_requests_replay_with_their_origins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = Bench(tmp_path, latched=Latch.RESTART)
    client = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        b.hand.values["position"][:] = np.sin(k / 20)
        if k in (10, 20, 180):
            b.ask("reset")
        if k in (60, 110):
            client.send(RequestKind.STOP, EVER)
        if k == 80 or k > 110:
            client.send(RequestKind.RESET, EVER)
        if k == 140:
            b.ask("stop")

    b.run(200, script)
    results = {(r[CYCLE.request_origin], r[CYCLE.request_result]) for r in b.rows() if r[CYCLE.request_origin]}
    assert results >= {
        (Origin.LOCAL, Answer.DONE), (Origin.LOCAL, Answer.REFUSED_STATE), (Origin.BUS, Answer.DONE),
        (Origin.BUS, Answer.REFUSED_LATCH), (Origin.BUS, Answer.REFUSED_RATE),
    }  # fmt: skip
    assert_replays(b, monkeypatch)
