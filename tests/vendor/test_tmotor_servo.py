"""TMotorCANControl 1.2.6, unchanged but for one name that it uses and never sets, on the twin of servo mode.

Its constructor calls sudo and opens socketcan, so it is given a bus and never made by it.
"""

import can
import numpy as np
import pytest
from helpers.can_drives import TwinRig, cell, servo

servo_can = pytest.importorskip("TMotorCANControl.servo_can")
servo_can.CAN_Manager_servo.__del__ = lambda self: None  # it would take a network interface down


@pytest.fixture
def rig():
    config = servo()
    with TwinRig(config, cell("cubemars-servo", ("hip", "knee"), gravity=False), opened=False) as made:
        yield made


@pytest.fixture
def client(rig, monkeypatch):
    monkeypatch.setattr(servo_can, "send_index", 4, raising=False)  # NameError without it
    made = object.__new__(servo_can.CAN_Manager_servo)
    made.bus = can.Bus(interface="virtual", channel=rig.twin.address.removeprefix("can://virtual/"))
    yield made
    made.bus.shutdown()


def newest(rig, drive=1):
    """The newest status of a drive, as the client takes it from the bus."""
    return bytes([m for m in rig.heard() if m.arbitration_id == 0x2900 | drive][-1].data)


def test_current_moves_the_axis_and_brake_stops_it(rig, client):
    for _ in range(20):
        client.comm_can_set_current(1, 1.0)
        rig.bench.run(0.01)
    state = client.parse_servo_message(newest(rig))
    truth = rig.bench.world.truth_arrays
    assert state.position == pytest.approx(np.degrees(truth["arm_position"][0]), abs=2.0)
    assert state.position > 3.0
    assert state.velocity == pytest.approx(truth["arm_velocity"][0] * 60 / 2 / np.pi * 9 * 21, rel=0.1)
    assert state.current == pytest.approx(1.0, abs=0.02)
    assert state.error == 0
    for _ in range(30):
        client.comm_can_set_cb(1, 5.0)
        rig.bench.run(0.01)
    assert abs(truth["arm_velocity"][0]) < 0.1


def test_speed(rig, client):
    for _ in range(30):
        client.comm_can_set_rpm(1, 2000)
        rig.bench.run(0.01)
    state = client.parse_servo_message(newest(rig))
    assert state.velocity == pytest.approx(2000, rel=0.05)
    assert rig.bench.world.truth_arrays["arm_velocity"][0] == pytest.approx(2000 / 60 * 2 * np.pi / 9 / 21, rel=0.05)


def test_its_origin_moves_the_twin_s_zero(rig, client):
    """The twin obeys the frame that this driver never sends."""
    for _ in range(20):
        client.comm_can_set_current(1, 1.0)
        rig.bench.run(0.01)
    client.comm_can_set_origin(1, 0)
    rig.bench.run(0.02)
    assert rig.twin.nodes[0].origins == [1, 0]
    assert abs(client.parse_servo_message(newest(rig)).position) < 3.0


def test_what_doesn_t_work_in_the_client(rig, client):
    """Why it is no judge of positions and of negative numbers."""
    with pytest.raises(TypeError):
        client.comm_can_set_pos(1, 90.0)
    with pytest.raises(TypeError):
        client.comm_can_set_pos_spd(1, 90.0, 5000, 30000)
    with pytest.raises(OverflowError):
        client.parse_servo_message(bytes.fromhex("fc7c012cfe0c1e06"))
