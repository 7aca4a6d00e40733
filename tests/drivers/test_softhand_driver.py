"""The SoftHand driver against its twin on a pty: real time, one world, generous patience."""

import os
import time

import numpy as np
import pytest
from helpers.ft import Server, bound
from helpers.wait import until

from srl.drivers.softhand import SoftHand, protocol
from srl.drivers.softhand.config import SoftHandConfig
from srl.drivers.softhand.driver import GONE, Motor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Kind, Stop
from srl.sim.devices.softhand.fake import FakeSoftHand, FakeSoftHandOptions
from srl.sim.devices.softhand.twin import SoftHandTwin
from srl.sim.parts.robots.softhand import SoftHandConfig as PartOptions
from srl.sim.parts.robots.softhand import SoftHandPart
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000


def twin(**config):
    parts = {"hand": (SoftHandPart, PartOptions())}
    world = Cell(
        CellConfig.model_construct(timestep=0.001, gravity=(0.0, 0.0, 0.0), floor=False, duration=None, parts=parts), 1
    )
    device = SoftHandConfig(port="/dev/null", **config)
    made = SoftHandTwin(FakeSoftHand("hand", device, world, FakeSoftHandOptions(noise=0.0)))
    made.keep_log = True
    return made


@pytest.fixture
def server():
    with Server(twin(limits=(100, 17_500))) as running:
        yield running


def driver(server, **config):
    return bound(SoftHand("hand", SoftHandConfig(port=server.twin.address, **config)))


@pytest.fixture
def opened(server, monkeypatch):
    """Without a watchdog and with much patience: a busy machine may stall this test at any instant."""
    monkeypatch.setattr("srl.drivers.softhand.driver.GONE", 10_000 * MS)
    monkeypatch.setattr("srl.drivers.softhand.driver.TIMEOUT", 10_000 * MS)
    hand = driver(server, watchdog=0)
    hand.open()
    yield hand
    hand.close()


@pytest.fixture
def guarded(server, monkeypatch):
    """With its watchdog, whose time is the twin's, and with as much patience."""
    monkeypatch.setattr("srl.drivers.softhand.driver.GONE", 10_000 * MS)
    hand = driver(server)
    hand.open()
    yield hand
    hand.close()


def position(hand):
    return float(hand.state_arrays["position"][0])


def idle(hand):
    hand.read(time.monotonic_ns())


def to(hand, closure):
    """A cycle that asks for `closure`."""

    def cycle():
        now = time.monotonic_ns()
        hand.read(now)
        hand.command_arrays["position_command"][:] = closure
        hand.write(now)
        time.sleep(0.002)

    return cycle


def reference(server):
    return server.twin.metrics()["reference"]


def test_it_declares_a_closure_with_feedback():
    hand = SoftHand("hand", SoftHandConfig(port="/dev/null"))
    (command,) = hand.commands
    assert (command.kind, command.feedback, command.stops) == (Kind.POSITION, "position", (Stop.HOLD, Stop.LIMP))
    assert command.unit == hand.states[0].unit == "1"
    assert (hand.limits["position_command"].lower[0], hand.limits["position_command"].upper[0]) == (0.0, 1.0)


def test_opening_finds_the_range_arms_the_watchdog_and_leaves_the_motor_off(server, guarded):
    assert guarded.metrics()["range"] == [100, 17_500]
    assert guarded.metrics()["serial"] == str(server.twin.serial_number)
    assert "by the hand itself" in guarded.health.message
    assert server.twin.metrics()["watchdog_ms"] == 250
    until(lambda: guarded.health.stamp > 0, lambda: idle(guarded))
    assert not server.twin.metrics()["active"]
    assert "SET_INPUTS" not in server.twin.metrics()["commands"]
    assert abs(position(guarded)) < 0.02
    assert guarded.health.connected


def test_it_closes_and_opens_by_the_motor_s_own_motion(server, opened):
    began = time.monotonic_ns()
    until(lambda: position(opened) > 0.5, to(opened, 0.6))
    assert time.monotonic_ns() - began > 100 * MS  # the hand itself takes its time: no echo
    assert reference(server) == round(100 + 0.6 * 17_400)
    assert opened._motor is Motor.ON
    currents = []
    until(
        lambda: position(opened) < 0.1, lambda: (to(opened, 0.0)(), currents.append(opened.state_arrays["current"][0]))
    )
    assert np.abs(currents).max() > 0.01


def test_the_first_command_switches_on_before_any_reference(server, opened):
    until(lambda: opened._sent is not None, to(opened, 0.3))
    until(lambda: reference(server) == round(100 + 0.3 * 17_400), to(opened, 0.3))
    rx = server.twin.log()["rx"].tobytes()
    assert rx.find(protocol.activate(1, True)) < rx.find(protocol.set_inputs(1, round(100 + 0.3 * 17_400)))
    assert server.twin.metrics()["errors"] == 0


def test_commands_beyond_the_range_stop_at_its_ends_and_nan_keeps_the_last(server, opened):
    until(lambda: reference(server) == 17_500, to(opened, 7.0))
    until(lambda: reference(server) == 100, to(opened, -7.0))
    until(lambda: reference(server) == 8_800, to(opened, 0.5))
    cycle = to(opened, np.nan)
    for _ in range(30):
        cycle()
    assert reference(server) == 8_800
    assert server.twin.metrics()["active"]


def test_an_unchanged_command_is_repeated_so_that_a_lost_one_is_made_good(server, opened):
    until(lambda: position(opened) > 0.2, to(opened, 0.3))
    with server.paused():
        server.twin._inputs = (0, 0)
        server.twin.hand.refer(100)  # as if the newest reference had been damaged on the line
    until(lambda: reference(server) == round(100 + 0.3 * 17_400), to(opened, 0.3))
    assert server.twin.metrics()["watchdog_trips"] == 0


def test_limp_switches_off_until_the_hand_confirms_it(server, opened):
    until(lambda: position(opened) > 0.3, to(opened, 0.5))
    opened.stop(Stop.LIMP)
    opened.stop(Stop.LIMP)
    until(lambda: not server.twin.metrics()["active"], lambda: idle(opened))
    until(lambda: opened._motor is Motor.OFF, lambda: idle(opened))
    assert opened.health.fault == ""


def test_a_lost_off_is_sent_again(server, opened):
    until(lambda: opened._motor is Motor.ON, to(opened, 0.1))
    server.twin.deaf = True
    opened.stop(Stop.LIMP)
    for _ in range(40):
        idle(opened)
        time.sleep(0.005)
    assert opened._motor is Motor.TURNING_OFF
    server.twin.deaf = False
    until(lambda: opened._motor is Motor.OFF, lambda: idle(opened))
    assert not server.twin.metrics()["active"]


def test_hold_sends_nothing_new(server, opened):
    until(lambda: position(opened) > 0.3, to(opened, 0.4))
    opened.stop(Stop.HOLD)
    until(lambda: opened.health.frames > 0, to(opened, 0.4))
    assert server.twin.metrics()["active"]
    assert reference(server) == round(100 + 0.4 * 17_400)


def test_a_dead_host_trips_the_watchdog_which_is_a_fault_until_recovered(server, guarded):
    until(lambda: position(guarded) > 0.3, to(guarded, 0.4))
    until(lambda: server.twin.metrics()["watchdog_trips"] == 1)  # nobody writes
    assert not server.twin.metrics()["active"]
    until(lambda: "switched its motor off" in guarded.health.fault, to(guarded, 0.4))
    assert guarded.health.connected
    for _ in range(20):
        to(guarded, 0.4)()
    assert not server.twin.metrics()["active"]  # nothing moves before a person says so
    guarded.recover(time.monotonic_ns())
    assert guarded.health.fault == ""
    idle(guarded)
    assert not server.twin.metrics()["active"]
    until(lambda: server.twin.metrics()["active"], to(guarded, 0.1))
    assert guarded.metrics()["switched_off"] == 1


def test_a_hand_that_doesn_t_switch_on_is_a_fault(server, guarded):
    server.twin.deaf = True
    until(lambda: "doesn't switch its motor on" in guarded.health.fault, to(guarded, 0.2))
    server.twin.deaf = False
    guarded.recover(time.monotonic_ns())
    until(lambda: guarded._motor is Motor.ON, to(guarded, 0.2))


def test_a_stalled_hand_never_has_two_commands_waiting(server, opened):
    until(lambda: opened._motor is Motor.ON and opened._sent is not None, to(opened, 0.2))
    with server.paused():
        before = len(server.twin.log()["reference"])
        at = time.monotonic_ns()
        for k in range(100):  # 0.4 s by the loop's clock, other commands each cycle
            opened.read(at + k * 4 * MS)
            opened.command_arrays["position_command"][:] = 0.2 + 0.005 * k
            opened.write(at + k * 4 * MS)
        assert opened.health.unsent > 0
    until(lambda: opened.health.unsent == 0, lambda: idle(opened))
    assert len(server.twin.log()["reference"]) - before <= 1


def test_a_silent_hand_is_lost_and_comes_back(server, guarded, monkeypatch):
    until(lambda: guarded.health.stamp > 0, lambda: idle(guarded))
    server.twin.muted = True
    with monkeypatch.context() as patch:
        patch.setattr("srl.drivers.softhand.driver.GONE", GONE)
        with pytest.raises(DeviceLostError, match=r"no answer for 0\.5 s"):
            until(lambda: False, lambda: idle(guarded))
    assert not guarded.health.connected
    with pytest.raises(DeviceError, match=r"no SoftHand with id 1 answered.*24 V"):
        guarded.open()
    server.twin.muted = False
    guarded.open()
    assert guarded.health.reconnects == 1
    until(lambda: guarded.health.stamp > 0, lambda: idle(guarded))


def test_a_pulled_cable_is_a_loss_and_closing_is_always_possible(server, opened):
    until(lambda: position(opened) > 0.1, to(opened, 0.3))
    with server.paused():
        server.twin.close()
    with pytest.raises(DeviceLostError):
        until(lambda: False, to(opened, 0.3))
    opened.stop(Stop.LIMP)
    opened.close()
    opened.close()
    with pytest.raises(DeviceLostError):
        idle(opened)


def test_closing_switches_the_motor_off(server, opened):
    until(lambda: opened._motor is Motor.ON, to(opened, 0.2))
    opened.close()
    until(lambda: not server.twin.metrics()["active"])
    assert server.twin.metrics()["watchdog_trips"] == 0


@pytest.mark.parametrize("cut", [0, 1, 3, 5, 8])
def test_the_limp_frame_stops_it_whatever_was_cut_short(server, opened, cut):
    until(lambda: opened._motor is Motor.ON and opened._sent is not None, to(opened, 0.2))
    assert sum(map(len, opened.stop_frames(Stop.LIMP))) <= 496
    os.write(opened.fileno(), protocol.set_inputs(1, 9000)[:cut])
    os.write(opened.fileno(), *opened.stop_frames(Stop.LIMP))
    until(lambda: not server.twin.metrics()["active"])
    assert server.twin.metrics()["watchdog_trips"] == 0


def test_the_hold_frame_keeps_the_grip_of_a_hand_whose_host_died(server, guarded):
    until(lambda: position(guarded) > 0.3, to(guarded, 0.4))
    frames = guarded.stop_frames(Stop.HOLD)
    assert guarded.stop_frames(Stop.HOLD) is frames
    os.write(guarded.fileno(), *frames)
    until(lambda: server.twin.metrics()["watchdog_ms"] == 0)
    time.sleep(0.4)  # longer than the watchdog was
    assert server.twin.metrics()["active"]
    assert reference(server) == round(100 + 0.4 * 17_400)


def test_a_service_that_starts_again_doesn_t_let_go_what_the_hand_holds(server, guarded):
    until(lambda: position(guarded) > 0.3, to(guarded, 0.4))
    os.write(guarded.fileno(), *guarded.stop_frames(Stop.HOLD))
    until(lambda: server.twin.metrics()["watchdog_ms"] == 0)
    link, guarded._link = guarded._link, None  # the loop died
    link.close()
    again = driver(server)
    again.open()
    for _ in range(80):
        idle(again)
        time.sleep(0.005)
    assert server.twin.metrics()["active"]
    held = reference(server)
    until(lambda: again._motor is Motor.ON, to(again, position(again)))
    assert server.twin.metrics()["watchdog_ms"] == 250
    assert abs(reference(server) - held) < 1500  # switched on again where it was
    again.close()


def test_before_any_command_the_hold_frame_is_off_too(opened):
    assert opened.stop_frames(Stop.HOLD) == opened.stop_frames(Stop.LIMP)


def test_an_adapter_s_echo_isn_t_taken_for_answers():
    made = twin(id=7)
    made.echo = True
    with Server(made) as server:
        hand = driver(server, id=7)
        hand.open()
        until(lambda: position(hand) > 0.2, to(hand, 0.3))
        assert hand.health.errors == 0
        hand.close()


def test_the_echo_alone_is_no_hand():
    made = twin()
    made.echo, made.id = True, 9
    with Server(made) as server, pytest.raises(DeviceError, match="no SoftHand with id 1 answered"):
        driver(server).open()


def test_the_range_is_assumed_where_the_hand_doesn_t_tell_and_the_profile_s_where_it_says():
    made = twin()
    made.parameters = False
    with Server(made) as server:
        hand = driver(server)
        hand.open()
        assert hand.metrics()["range"] == [0, 19_000]
        assert "assumed" in hand.health.message
        hand.close()
        hand = driver(server, limits=(50, 16_000))
        hand.open()
        assert hand.metrics()["range"] == [50, 16_000]
        hand.close()


@pytest.mark.parametrize(
    ("control", "limits", "words"),
    [
        (2, None, "control its current, so a reference is no position"),
        (9, None, "control its 9,"),
        (0, (-500, 16_000), "within 0 and 19000 ticks; the profile's limits are -500 and 16000"),
    ],
)
def test_what_the_hand_keeps_must_be_what_the_profile_means(control, limits, words):
    made = twin()
    made.control = control
    with Server(made) as server, pytest.raises(DeviceError, match=words):
        driver(server, limits=limits).open()


def test_a_hand_without_a_watchdog_must_be_accepted(server):
    del server.twin._answers[protocol.Cmd.SET_WATCHDOG]
    with pytest.raises(DeviceError, match=r"doesn't acknowledge its watchdog.*'watchdog: 0'"):
        driver(server).open()
    hand = driver(server, watchdog=0)
    hand.open()
    hand.close()


@pytest.mark.parametrize("config", [{"id": 0}, {"limits": (5, 5)}, {"watchdog": 0.05}, {"baudrate": 9600}])
def test_wrong_options_are_said(config):
    with pytest.raises(ValueError, match="SoftHandConfig"):
        SoftHandConfig(port="/dev/null", **config)


def test_limp_lets_go_of_a_hand_that_was_found_switched_on(server, guarded):
    until(lambda: position(guarded) > 0.3, to(guarded, 0.4))
    os.write(guarded.fileno(), *guarded.stop_frames(Stop.HOLD))
    until(lambda: server.twin.metrics()["watchdog_ms"] == 0)
    link, guarded._link = guarded._link, None  # the loop died, its supervisor had the hand hold on
    link.close()
    again = driver(server)
    again.open()
    until(lambda: again.health.stamp > 0, lambda: idle(again))
    assert server.twin.metrics()["active"]
    again.stop(Stop.LIMP)  # nothing was commanded since it was opened
    until(lambda: not server.twin.metrics()["active"], lambda: idle(again))
    until(lambda: again._motor is Motor.OFF, lambda: idle(again))
    before = server.twin.metrics()["commands"]["ACTIVATE"]
    for _ in range(20):
        again.stop(Stop.LIMP)  # each cycle of the stop
        idle(again)
    assert server.twin.metrics()["commands"]["ACTIVATE"] == before
    again.close()
