"""Single faults and requests against Cycle, Device and Loop, with a toy arm and no hardware."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.toy import SPEED, Bench, Toy, _load

from srl.runtime.contracts import registry
from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc.header import FLAG_DEGRADED, Cause, State
from srl.runtime.ipc.requests import Answer
from srl.runtime.loop import device as device_module
from srl.runtime.loop.replay import replay


def test_a_stop_begins_in_the_cycle_of_its_fault(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        b.hand.values["position"][:] = 1.5
        if k == 50:
            b.panel.values["buttons"][2] = 1

    b.run(120, script)
    state, sent = b.header("state"), np.array(b.arm.sent)[:, 0]
    assert state[49] == State.ACTIVE
    assert state[50] in (State.STOPPING, State.STOPPED)
    assert abs(np.diff(sent)).max() <= SPEED * 0.01 * (1 + 1e-6)
    assert np.ptp(sent[-20:]) == 0


def test_twenty_periods_missed_within_a_second_stop_the_limb_and_fewer_dont(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        late = k % 6 == 0 if k < 600 else k == 600  # 17 in each second
        b.loop.clock.tick.missed = 3 if k == 601 else late

    b.run(620, script)
    assert {state for state, _ in b.states[5:602]} == {State.ACTIVE}
    assert b.header("state")[601] in (State.STOPPING, State.STOPPED)
    assert b.states[-1] == (State.STOPPED, Cause.OVERRUN)
    degraded = (b.header("flags") & FLAG_DEGRADED) > 0
    assert degraded.tolist()[:32] == [False] * 30 + [True] * 2, "above five in a second telemetry is halved"


def test_a_stop_that_the_device_does_by_itself_is_asked_of_it_in_each_cycle_and_ends_with_the_reset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No position is `limp`: nothing but the driver's own stop lets the joints go."""
    asked: list[tuple[int, Stop]] = []
    b = Bench(tmp_path, emergency="", more="stop: {arm: limp}")
    sent = []

    def script(k: int) -> None:
        sent.append(len(b.arm.sent))
        if k == 50:
            monkeypatch.setattr(Toy, "stop", lambda self, category: asked.append((len(sent) - 1, category)))
            b.ask("stop")
        if k == 80:
            b.ask("reset")

    b.run(100, script)
    assert asked == [(k, Stop.LIMP) for k in range(50, 80)], "from the stop's own cycle on"
    assert sent[50] == sent[80], "and no command beside it"
    assert sent[99] > sent[81]


def test_a_driver_whose_write_fails_stops_the_limb(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.arm.defect = ValueError("a defect")

    b.run(100, script)
    assert b.states[-1][1] is Cause.DRIVER_ERROR


def test_a_device_that_refuses_to_move_stops_the_limb_and_recovers_only_when_told(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    sent_in_fault = 0

    def script(k: int) -> None:
        nonlocal sent_in_fault
        if k == 30:
            b.arm.health.fault = "protective stop"
        if k == 31:
            sent_in_fault = len(b.arm.sent)
        if k == 60:
            assert (b.arm.recoveries, len(b.arm.sent)) == (0, sent_in_fault)
            b.ask("reset")
        if k == 70:
            assert b.arm.recoveries == 1
            b.arm.health.fault = ""
        if k == 80:
            assert b.cycle.machine.state is State.STOPPED
            assert len(b.arm.sent) == sent_in_fault
            b.ask("reset")

    b.run(100, script)
    assert b.header("state")[30] in (State.STOPPING, State.STOPPED)
    assert b.states[50] == (State.STOPPED, Cause.DEVICE_FAULT)
    assert b.states[-1] == (State.ACTIVE, Cause.NONE)
    assert b.arm.recoveries == 1
    assert any("protective stop" in event for event in b.events)
    assert any("well again" in event for event in b.events)


def test_a_stop_that_overtakes_a_reset_leaves_it_refused(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(80, _stop_then_both(b))
    assert (b.header("state")[45:] == State.STOPPED)[:-1].all()


def _stop_then_both(b: Bench) -> Callable[[int], None]:
    def script(k: int) -> None:
        if k == 20:
            b.ask("stop")
        if k == 50:
            b.ask("reset")
            b.ask("stop")

    return script


def test_a_device_that_came_back_gets_no_command_before_a_reset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    b = Bench(tmp_path)
    sent = []

    def script(k: int) -> None:
        if k == 50:
            b.arm.gone = True
        if k == 80:
            b.arm.gone = False
            sent.append(len(b.arm.sent))
        if k == 90:
            b.until_back(b.arm)

    b.run(160, script)
    assert any("is back" in event for event in b.events)
    assert len(b.arm.sent) == sent[0]


def test_a_limp_device_whose_write_failed_once_can_be_reset(tmp_path: Path) -> None:
    b = Bench(tmp_path, more="stop: {arm: limp}")

    def script(k: int) -> None:
        b.arm.defect = ValueError("once") if k == 50 else None
        if k == 100:
            b.ask("reset")

    b.run(150, script)
    assert b.states[99][0] is State.STOPPED
    assert b.states[-1][0] is State.ACTIVE


def test_a_loss_in_write_is_seen_however_soon_it_is_back(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.arm.gone_in_write = True
        if k == 51:
            b.until_back(b.arm)

    b.run(100, script)
    assert b.states[-1][1] is Cause.DEVICE_LOSS


@pytest.mark.parametrize("read", [np.nan, np.inf, -np.inf])
def test_an_emergency_input_that_is_no_number_stops_as_a_pressed_one(tmp_path: Path, read: float) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        b.panel.values["buttons"][3] = read if 50 <= k < 80 else 0.0
        if k in (70, 90):
            b.ask("reset")

    b.run(100, script)
    assert b.header("state")[50] in (State.STOPPING, State.STOPPED)
    assert b.header("cause")[50] == Cause.EMERGENCY
    assert b.states[85] == (State.STOPPED, Cause.EMERGENCY)
    assert b.header("request_result")[70] == Answer.REFUSED_FAULT
    assert b.states[-1][0] is State.ACTIVE


def test_a_pressed_stop_button_refuses_the_reset(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.panel.values["buttons"][3] = 1
        if k == 80:
            b.ask("reset")

    b.run(100, script)
    assert {s for s, _ in b.states[60:]} == {State.STOPPED}


def test_a_stop_button_that_is_unplugged_stops_the_limb(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.panel.gone = True

    b.run(100, script)
    assert b.states[-1][0] is State.STOPPED


@pytest.mark.parametrize("what", ["fault", "stop", "exit"])
def test_no_datagram_ends_the_loop(tmp_path: Path, what: str) -> None:
    b = Bench(tmp_path, emergency="")
    b.run(60, lambda k: b.ask(what, cause="emergency") if k == 50 else None)


def test_a_homing_that_was_broken_off_goes_on_without_a_step(tmp_path: Path) -> None:
    """A servo that was lost goes home slowly after the reset; a loss of intent on the way breaks that off."""
    b = Bench(tmp_path, arm="servo", emergency="")
    started: list[int] = []

    def script(k: int) -> None:
        if k == 100:
            b.arm.gone_in_write = True
        if k == 102:
            b.until_back(b.arm)
            started.append(len(b.arm.sent))
        if k in (110, 162):
            b.ask("reset")
        if k == 115:
            b.hand.silent = True
        if k == 160:
            b.hand.silent = False

    b.run(300, script)
    assert b.states[105] == (State.STOPPED, Cause.DEVICE_LOSS)
    assert b.states[112][0] is State.HOMING
    assert b.states[150] == (State.STOPPED, Cause.INTENT_LOSS)
    sent = np.array(b.arm.sent)
    assert np.abs(np.diff(sent, axis=0)).max() <= SPEED * 0.01 * (1 + 1e-6)
    assert np.abs(np.diff(sent[started[0] :][:5], axis=0)).max() <= SPEED * 0.01 / 4 * (1 + 1e-6)


def test_a_loss_in_write_leaves_no_stop_frame(tmp_path: Path) -> None:
    """The frame would reach the device after it was opened again, and its driver belongs to another thread by then."""
    b = Bench(tmp_path)
    stored: list[bool] = []
    (arm,) = b.loop.commanded
    arm.on_loss = lambda device: stored.clear()
    b.loop.after_write = lambda device: stored.append(device.lost)

    def script(k: int) -> None:
        if k == 100:
            assert stored
            b.arm.gone_in_write = True
        if k == 102:
            assert stored == []
            b.until_back(b.arm)

    b.run(120, script)
    assert arm.lost is False
    assert stored == []


def test_a_reset_that_was_overtaken_replays_as_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = Bench(tmp_path)
    b.run(80, _stop_then_both(b))
    monkeypatch.setattr(registry, "load", _load)
    assert replay(b.graph.layout, b.rows()[:-1], "toy").identical


def test_an_exit_always_ends(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(150, lambda k: b.ask("exit", cause="bus_loss") if k == 50 else None)
    assert len(b.states) < 150


def test_a_guard_knows_that_its_measurements_are_old(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="")
    unmeasured: dict[int, bool] = {}

    def script(k: int) -> None:
        unmeasured[k] = b.cycle.guards[0].unmeasured
        if k == 50:
            b.arm.silent = True

    b.run(80, script)
    assert b.states[75][1] is Cause.DEVICE_LOSS
    assert (unmeasured[50], unmeasured[75]) == (False, True)
