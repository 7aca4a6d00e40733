"""The ODrive driver on its twin: first command, stops, faults. All in memory and in lockstep."""

import struct

import can
import numpy as np
import pytest
from helpers.can_drives import TwinRig, fault, floating, odrive, of

from srl.drivers.odrive import protocol
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Kind, Stop


@pytest.fixture
def rig():
    config = odrive()
    with TwinRig(config, floating(config)) as made:
        yield made


def states(rig):
    return [node.state for node in rig.twin.nodes]


# -- commands


def test_none_goes_on_from_its_first_command_until_all_obey(rig):
    rig.run(0.02)
    of(rig, 1).mute = True  # before it can say that it obeys
    rig.run(0.005, [0.0, 0.0])
    rig.run(0.3, [0.1, 0.1])
    assert states(rig) == [8, 8]
    assert rig.driver.sent_arrays["position_command"] == pytest.approx([0.0, 0.0])
    assert rig.driver.state_arrays["position"] == pytest.approx([0.0, 0.0], abs=2e-3)
    of(rig, 1).mute = False
    rig.run(0.3, [0.0, 0.0])
    assert rig.driver.sent_arrays["position_command"] == pytest.approx([0.0, 0.0])
    rig.run(0.5, [0.2, -0.1])
    assert rig.driver.state_arrays["position"] == pytest.approx([0.2, -0.1], abs=0.02)
    assert fault(rig) == ""


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
@pytest.mark.parametrize("mode", ["position", "velocity", "torque"])
def test_each_mode_moves_the_axis_its_way(firmware, mode):
    config = odrive(firmware=firmware, mode=mode, axis={"reversed": True})
    world = floating(config, reversed=True)
    with TwinRig(config, world) as rig:
        still = [0.0, 0.0]
        rig.run(0.3, still)
        assert states(rig) == [8, 8]
        assert rig.driver.state_arrays["position"] == pytest.approx(still, abs=2e-3)
        rig.run(0.2, {"position": [0.2, 0.0], "velocity": [0.8, 0.0], "torque": [0.6, 0.0]}[mode])
        assert rig.driver.state_arrays["position"][0] > 0.03
        assert rig.driver.state_arrays["velocity"][0] > 0
        assert world.truth_arrays["arm_position"][0] == pytest.approx(rig.driver.state_arrays["position"][0], abs=0.04)
        (command,) = rig.driver.commands
        assert command.kind is Kind(mode)
        assert (Stop.DAMP in command.stops) == (mode == "torque")


def test_an_old_input_is_overwritten_before_the_state():
    config = odrive(mode="velocity")
    with TwinRig(config, floating(config)) as rig:
        rig.run(0.02)
        rig.twin.take(protocol.input_velocity(1, 5.0), 0)  # what an earlier program left behind
        rig.heard()
        rig.run(0.3, [0.0, 0.0])
        first = [protocol.split(m.arbitration_id)[1] for m in rig.heard() if m.arbitration_id >> 5 == 1 and m.data]
        order = [c for c in first if c in (0x0B, 0x0D, 0x07)]
        assert order[:3] == [0x0B, 0x0D, 0x07]
        assert abs(world_position(rig)).max() < 0.01


def world_position(rig):
    return np.array(rig.bench.world.truth_arrays["arm_position"])


def test_a_command_far_from_the_axis_isn_t_followed(rig):
    rig.run(0.02)
    rig.run(0.3, [0.5, 0.0])
    assert states(rig)[0] == protocol.IDLE
    assert "hip is too far from its first command" in fault(rig)


# -- stops


def test_limp_is_repeated_until_each_axis_says_so(rig):
    rig.run(0.4, [0.0, 0.0])
    of(rig, 1).deaf = True
    rig.run(0.2, stop=Stop.LIMP)
    assert states(rig)[0] == protocol.IDLE
    assert states(rig)[1] == protocol.CLOSED_LOOP
    of(rig, 1).deaf = False
    rig.run(0.05)  # `read` goes on with it
    assert states(rig) == [protocol.IDLE] * 2
    rig.run(0.4)
    rig.heard()
    rig.run(0.3)
    assert not [m for m in rig.heard() if protocol.split(m.arbitration_id)[1] == 7], "no more once they are limp"
    rig.run(0.4, [0.0, 0.0])
    assert states(rig) == [8, 8], "and they can be started again"
    assert fault(rig) == ""


@pytest.mark.parametrize("mode", ["position", "velocity", "torque"])
@pytest.mark.parametrize("category", [Stop.HOLD, Stop.LIMP])
def test_stop_frames(mode, category, monkeypatch):
    config = odrive(mode=mode)
    with TwinRig(config, floating(config)) as rig:
        frames = []
        link = rig.driver._link
        monkeypatch.setattr(link, "stop_frame", lambda m: frames.append(m) or bytes(m.data))
        rig.run(0.4, [0.0, 0.0])
        found = rig.driver.stop_frames(category)
        assert rig.driver.stop_frames(category) is found
        output = [(m.arbitration_id >> 5, m.arbitration_id & 31, bytes(m.data)) for m in frames]
        if category is Stop.LIMP:
            assert output == [(node, 0x07, struct.pack("<II", 1, 0)) for node in (1, 2)]
        elif mode == "position":
            assert [(node, command) for node, command, _ in output] == [(1, 0x0C), (2, 0x0C)]
        else:
            still = [(node, 0x0D, bytes(8)) for node in (1, 2)]
            damp = [(node, 0x0B, struct.pack("<II", 2, 1)) for node in (1, 2)]
            assert sorted(output) == sorted(still if mode == "velocity" else still + damp)


def test_socketcan_s_stop_frames_are_whole_frames(rig, monkeypatch):
    monkeypatch.setattr(rig.driver._link, "interface", "socketcan")
    rig.run(0.4, [0.0, 0.0])
    frames = rig.driver.stop_frames(Stop.LIMP)
    assert [struct.unpack_from("=IB", frame) for frame in frames] == [(0x27, 8), (0x47, 8)]
    assert {len(frame) for frame in frames} == {16}


# -- faults


def test_the_watchdog_lets_go_and_says_so(rig):
    rig.run(0.4, [0.0, 0.0])
    rig.run(0.7)  # reads, and never writes: a law that hangs
    assert not any(rig.twin.metrics()["torque"])
    assert "hip heard nothing for the watchdog's time and coasted (see why the commands stopped)" in fault(rig)
    rig.driver.recover(rig.bench.now)
    rig.run(0.2)
    assert fault(rig) == ""
    rig.run(0.4, [0.0, 0.0])
    assert states(rig) == [8, 8]


def test_a_watchdog_that_ran_out_while_idle_is_no_fault(rig):
    rig.run(0.05)
    for node in rig.twin.nodes:
        node._disarm(1 << 24)
    rig.run(0.3)
    assert fault(rig) == ""
    rig.run(0.4, [0.0, 0.0])
    assert states(rig) == [8, 8]
    assert fault(rig) == ""


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (1 << 13, "motor that is too hot (let it cool"),
        (1 << 25, "emergency stop"),
        (1 << 26, "magnet or coupling slips"),
    ],
)
def test_an_error_is_told_with_its_remedy(rig, error, words):
    rig.run(0.4, [0.0, 0.0])
    of(rig)._disarm(error)
    rig.run(0.3, [0.0, 0.0])
    assert words in fault(rig)
    assert fault(rig).startswith("hip ")
    assert states(rig) == [1, 8], "the other axis goes on to hold"


def test_an_axis_that_drops_out_without_an_error_is_a_fault(rig):
    """Early firmware shows error 0 while the motor has failed."""
    rig.run(0.4, [0.0, 0.0])
    node = of(rig)
    node.state = protocol.IDLE
    node.motors.switch(node.i, False)
    rig.run(0.3, [0.0, 0.0])
    assert "hip fell out of closed loop control into idle: it coasts" in fault(rig)


def test_an_axis_that_doesn_t_begin(rig):
    of(rig)._request = lambda state: None
    rig.run(0.02)
    rig.run(1.2, [0.0, 0.0])
    assert "hip didn't begin to obey within a second" in fault(rig)


def test_a_brown_out_is_a_lost_position(rig):
    rig.run(0.4, [0.0, 0.0])
    rig.run(0.5, [0.5, 0.0])
    rig.twin._loss = ()
    of(rig).brown_out()
    rig.run(0.3, [0.5, 0.0])
    assert "hip jumped from 0.5" in fault(rig)
    assert not rig.twin.metrics()["torque"][0]
    before = world_position(rig)
    rig.driver.recover(rig.bench.now)
    rig.run(0.3, [0.5, 0.0])
    assert "hip jumped" in fault(rig), "a reset doesn't bring a position back"
    assert world_position(rig)[0] == pytest.approx(before[0], abs=0.02)


def test_one_silent_axis_stops_the_limb_and_leaves_the_others_held(rig):
    rig.run(0.4, [0.0, 0.0])
    of(rig).mute = True
    stamp = rig.driver.health.stamp
    rig.run(0.2, [0.0, 0.0])
    assert rig.driver.health.stamp <= stamp + 10_000_000, "the sample grows stale"
    rig.run(1.5, [0.0, 0.0])
    assert "hip is silent" in fault(rig)
    assert rig.driver.health.connected
    assert states(rig) == [8, 8], "a drive that can't speak may still hear"


def test_a_bus_on_which_nobody_speaks_is_lost(rig):
    rig.run(0.4, [0.0, 0.0])
    rig.twin.muted = True
    with pytest.raises(DeviceError, match="no drive has been heard for a second"):
        rig.run(1.5, [0.0, 0.0])
    assert not rig.driver.health.connected


def test_a_second_host_is_a_fault(rig):
    rig.run(0.4, [0.0, 0.0])
    rig.spy.send(protocol.input_position(1, 0.3))
    rig.run(0.02, [0.0, 0.0])
    assert "another program commands these drives (command 0x0c for hip)" in fault(rig)
    rig.spy.send(protocol.request(1, 0x17))  # one that only looks does no harm
    rig.driver.recover(rig.bench.now)
    rig.run(0.2)
    assert fault(rig) == ""


def test_garbage_is_counted_and_changes_nothing(rig):
    rig.run(0.1)
    before = rig.driver.state_arrays["position"].copy()
    for data in (b"", b"\0" * 7, struct.pack("<ff", float("nan"), 0.0)):
        rig.spy.send(can.Message(arbitration_id=1 << 5 | 9, data=data, is_extended_id=False))
    rig.spy.send(can.Message(arbitration_id=1 << 5 | 1, data=b"\1", is_extended_id=False))
    rig.spy.send(can.Message(arbitration_id=60 << 5 | 9, data=bytes(8), is_extended_id=False))
    rig.run(0.02)
    assert rig.driver.health.errors == 4
    assert rig.driver.state_arrays["position"] == pytest.approx(before)
    assert fault(rig) == ""


def test_of_a_queue_that_is_nearly_full_what_left_counts_as_sent(rig, monkeypatch):
    rig.run(0.4, [0.0, 0.0])
    rig.driver.sent_arrays["position_command"][:] = np.nan
    write, held = rig.driver._link.write, rig.driver.held(1)
    monkeypatch.setattr(rig.driver._link, "write", lambda message: message.arbitration_id >> 5 == 1 and write(message))
    rig.run(0.02, [0.05, 0.05])
    sent = rig.driver.sent_arrays["position_command"]
    assert sent[0] == 0.05
    assert np.isnan(sent[1])
    assert rig.driver.held(1) is held, "a stop frame repeats what left"
    rig.run(0.3, [0.05, 0.05])
    assert "the bus takes no commands" in fault(rig)


def test_a_full_queue_sends_nothing_and_says_so(rig, monkeypatch):
    rig.run(0.4, [0.0, 0.0])
    rig.driver.sent_arrays["position_command"][:] = np.nan
    monkeypatch.setattr(rig.driver._link, "write", lambda message: False)
    rig.run(0.02, [0.1, 0.0])
    assert np.isnan(rig.driver.sent_arrays["position_command"]).all()
