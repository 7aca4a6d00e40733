"""The driver of CubeMars actuators in servo mode on its twin. All in memory and in lockstep."""

import struct

import can
import numpy as np
import pytest
from helpers.can_drives import TwinRig, cell, fault, floating, servo
from pydantic import ValidationError

from srl.drivers.cubemars_servo import protocol
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Stop

NEVER = {0, 4, 5, 8}  # duty, position at full speed, set origin, MIT


@pytest.fixture
def rig():
    config = servo()
    with TwinRig(config, floating(config)) as made:
        yield made


def modes(rig):
    """Modes of all commands since the last call."""
    return {m.arbitration_id >> 8 for m in rig.heard()} - {protocol.STATUS}


def status(drive, degrees=0.0, error=0):
    data = struct.pack(">hhhbB", round(degrees * 10), 0, 0, 30, error)
    return can.Message(arbitration_id=0x2900 | drive, data=data, is_extended_id=True)


@pytest.mark.parametrize(
    ("axis", "words"),
    [
        ({"model": "AK80-99"}, "Input should be"),
        ({"upper": 60.0}, "beyond 3200 degrees"),
        ({"parked": 2.5}, "must lie between 'lower' and 'upper'"),
        ({"id": 4}, "id 4 is used twice"),
        ({"current": 61}, "less than or equal to 60"),
        ({"lower": 1.0, "upper": -1.0}, "must be less than upper"),
    ],
)
def test_a_profile_that_can_t_be_is_refused(axis, words):
    with pytest.raises(ValidationError, match=words):
        servo(axis=axis)


def test_the_time_limit_must_be_told():
    with pytest.raises(ValidationError, match="timeout"):
        servo(timeout=None)


def test_opening_only_listens(rig):
    assert modes(rig) == set()
    assert rig.driver.health.message == "drives let go after 0.5 s of silence, by the profile"


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda rig: setattr(rig.twin, "muted", True), "no actuator is heard"),
        (lambda rig: setattr(rig.twin.nodes[0], "mute", True), "'hip' .id 1. isn't heard; heard are ids 2"),
        (lambda rig: setattr(rig.twin.nodes[0], "id", 104), "'hip' .id 1. isn't heard; heard are ids 2, 104"),
    ],
)
def test_a_bus_that_isn_t_the_profile_s_is_refused(change, match, monkeypatch):
    monkeypatch.setattr("srl.drivers.cubemars_servo.driver.LISTEN", 0.15)
    config = servo()
    with TwinRig(config, floating(config), opened=False) as rig:
        change(rig)
        with pytest.raises(DeviceError, match=match) as caught:
            rig.open()
        assert caught.value.remedy


def test_an_actuator_in_mit_mode_is_told(monkeypatch):
    monkeypatch.setattr("srl.drivers.cubemars_servo.driver.LISTEN", 0.15)
    config = servo()
    with TwinRig(config, floating(config), opened=False) as rig:
        rig.twin.muted = True
        real = rig.twin.service
        rig.twin.service = lambda now: (rig.spy.send(can.Message(arbitration_id=0, is_extended_id=False)), real(now))
        with pytest.raises(DeviceError, match="none of an actuator in servo mode") as caught:
            rig.open()
        assert "MIT mode" in caught.value.remedy


def test_swapped_ids_show_by_their_parked_poses():
    """Nothing on the bus tells two actuators apart; axes that are parked at different angles do."""
    config = servo()
    axes = {"hip": config.axes["hip"].model_copy(update={"parked": 0.8}), "knee": config.axes["knee"]}
    config = config.model_copy(update={"axes": axes})
    world = cell("cubemars-servo", ("hip", "knee"), start=0.8, gravity=False)
    with TwinRig(config, world, opened=False) as rig:
        rig.twin.nodes[0].id, rig.twin.nodes[1].id = 2, 1
        with pytest.raises(DeviceError, match=r"'hip' says that it is at 0.00 rad; it must be parked at 0.8 rad"):
            rig.open()


def test_a_drive_that_was_switched_on_elsewhere_is_refused():
    """Its rotor's encoder can't tell turns: 40 degrees of the shaft with a gear of 9."""
    config = servo()
    with TwinRig(config, cell("cubemars-servo", ("hip", "knee"), start=0.5, gravity=False), opened=False) as rig:
        rig.twin.nodes[0].brown_out()  # at 0.5 rad, beyond half of 40 degrees
        with pytest.raises(DeviceError, match=r"says that it is at -0.2"):
            rig.open()


@pytest.mark.parametrize("mode", ["position", "velocity", "torque"])
@pytest.mark.parametrize("reversed_", [False, True])
def test_each_mode_moves_the_axis_its_way(mode, reversed_):
    config = servo(mode=mode, axis={"reversed": reversed_})
    with TwinRig(config, floating(config, reversed=reversed_)) as rig:
        rig.run(0.2, [0.0, 0.0])
        rig.run(0.3, {"position": [0.3, 0.0], "velocity": [0.8, 0.0], "torque": [0.7, 0.0]}[mode])
        position, velocity = rig.driver.state_arrays["position"], rig.driver.state_arrays["velocity"]
        assert position[0] > 0.05
        truth = rig.bench.world.truth_arrays["arm_position"][0]
        assert truth == pytest.approx(position[0], abs=0.002 + 0.03 * abs(velocity[0]))
        if mode == "position":
            assert position[0] == pytest.approx(0.3, abs=0.03)
        if mode == "velocity":
            assert velocity[0] == pytest.approx(0.8, rel=0.1)
        assert not modes(rig) & NEVER
        assert fault(rig) == ""


def test_a_jump_of_the_command_is_the_drive_s_own_ramp(rig):
    rig.run(0.1, [0.0, 0.0])
    fastest = 0.0
    for _ in range(100):
        rig.run(0.005, [1.5, 0.0])
        fastest = max(fastest, rig.bench.world.truth_arrays["arm_velocity"][0])
    assert 3.0 < fastest < 7.5, "6 rad/s by the profile"


def test_limp_is_no_current(rig):
    rig.run(0.2, [0.0, 0.0])
    rig.heard()
    rig.run(0.2, stop=Stop.LIMP)
    sent = [m for m in rig.heard() if m.arbitration_id >> 8 == 1]
    assert {bytes(m.data) for m in sent} == {bytes(4)}
    assert {m.arbitration_id & 0xFF for m in sent} == {1, 2}
    assert len(sent) <= 12, "not in every cycle"
    assert rig.twin.drives.chain.motors.kp.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("mode", "category", "wanted"),
    [
        ("position", Stop.HOLD, {6}), ("velocity", Stop.BRAKE, {2}), ("torque", Stop.DAMP, {2}),
        ("position", Stop.LIMP, {1}), ("torque", Stop.LIMP, {1}),
    ],
)  # fmt: skip
def test_stop_frames(mode, category, wanted, monkeypatch):
    config = servo(mode=mode)
    with TwinRig(config, floating(config)) as rig:
        frames = []
        monkeypatch.setattr(rig.driver._link, "stop_frame", lambda m: frames.append(m) or bytes(m.data))
        rig.run(0.2, [0.0, 0.0])
        rig.driver.stop_frames(category)
        assert {m.arbitration_id >> 8 for m in frames} == wanted
        assert sorted(m.arbitration_id & 0xFF for m in frames) == [1, 2]
        assert all(m.is_extended_id for m in frames)


def test_nothing_ever_sets_the_origin():
    """Whatever happens: opening, commands, stops, faults, recovery, loss."""
    for mode in ("position", "velocity", "torque"):
        config = servo(mode=mode)
        with TwinRig(config, floating(config)) as rig:
            rig.run(0.1, [0.0, 0.0])
            rig.spy.send(status(1, error=5))
            rig.run(0.05, [0.0, 0.0])
            for stop in Stop:
                rig.driver.stop(stop)
                rig.driver.stop_frames(stop)
            rig.driver.recover(rig.bench.now)
            rig.run(0.1)
            rig.driver.close()
            assert not modes(rig) & NEVER
            assert [node.origins for node in rig.twin.nodes] == [[0, 0]] * 2


# -- faults


@pytest.mark.parametrize(("error", "words"), [(1, "motor that is too hot"), (4, "too low a supply"), (7, "stalled")])
def test_an_error_is_told_with_its_remedy(rig, error, words):
    rig.run(0.2, [0.0, 0.0])
    rig.twin.nodes[0].mute = True
    rig.spy.send(status(1, error=error))
    rig.run(0.005, [0.0, 0.0])
    assert fault(rig).startswith("hip ")
    assert words in fault(rig)
    rig.twin.nodes[0].mute = False
    rig.run(0.1, [0.0, 0.0])
    assert words in fault(rig), "it stays until a reset"
    rig.driver.recover(rig.bench.now)
    rig.run(0.05)
    assert fault(rig) == ""


def test_a_brown_out_is_a_lost_position(rig):
    rig.run(0.2, [0.0, 0.0])
    rig.run(0.5, [1.0, 0.0])
    rig.twin.nodes[0].brown_out()
    rig.run(0.2, [1.0, 0.0])
    assert "hip jumped from 1.0" in fault(rig)
    before = np.array(rig.bench.world.truth_arrays["arm_position"])
    rig.driver.recover(rig.bench.now)
    rig.run(0.3, [1.0, 0.0])
    assert "hip jumped" in fault(rig)
    assert rig.bench.world.truth_arrays["arm_position"][0] == pytest.approx(before[0], abs=0.05)


def test_a_position_at_the_end_of_its_field_isn_t_trusted(rig):
    rig.run(0.1)
    rig.spy.send(status(1, degrees=3205.0))
    rig.run(0.005)
    assert "hip jumped" in fault(rig)


def test_status_that_waited_through_a_stall_is_as_old_as_it_is_and_moves_nothing(rig):
    """The loop hangs for 0.3 s, and meanwhile somebody moves the limb: what the kernel kept says where it was."""
    rig.run(0.3, 0.0)
    before = rig.driver.health.stamp
    rig.bench.now += 300_000_000
    rig.heard()
    rig.driver.read(rig.bench.now)
    assert rig.driver.health.stamp <= before + 20_000_000
    rig.driver.write(rig.bench.now)
    assert not modes(rig), "no command for an axis of which nobody knows where it is"
    rig.twin.service(rig.bench.now)
    rig.run(0.05, 0.0)
    assert rig.bench.now - rig.driver.health.stamp < 20_000_000
    assert modes(rig), "it goes on where it stands"
    assert fault(rig) == ""


def test_one_silent_drive_is_a_fault_and_the_others_are_held(rig):
    rig.run(0.2, [0.0, 0.0])
    rig.twin.nodes[0].mute = True
    rig.run(0.8, [0.0, 0.0])
    assert "hip is silent" in fault(rig)
    rig.heard()
    rig.run(0.1, [0.0, 0.0])
    assert {m.arbitration_id for m in rig.heard()} >= {0x601, 0x602}


def test_a_second_host_is_a_fault(rig):
    rig.run(0.2, [0.0, 0.0])
    rig.spy.send(can.Message(arbitration_id=0x501, data=b"\0", is_extended_id=True))
    rig.run(0.02, [0.0, 0.0])
    assert "another program commands these drives (origin for hip)" in fault(rig)


def test_garbage_is_counted(rig):
    rig.run(0.1)
    rig.spy.send(can.Message(arbitration_id=0x2901, data=b"\1\2", is_extended_id=True))
    rig.spy.send(can.Message(arbitration_id=0x001, data=bytes(8), is_extended_id=False))
    rig.run(0.02)
    assert rig.driver.health.errors == 1
    assert fault(rig) == ""


def test_a_warm_drive_is_told(rig):
    rig.twin.drives.chain.motors.stage[0] = 75.0
    rig.run(0.1, [0.0, 0.0])
    assert "hip is at 75 degC" in rig.driver.health.message
    assert fault(rig) == ""
