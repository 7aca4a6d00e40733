"""The Feetech twin on the wire: registers, groups, the lock, power-up, and bytes that make no sense."""

from functools import cache

import numpy as np
import pytest
from helpers.dynamixel import MS
from helpers.feetech import make_twin
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.feetech import protocol as p
from srl.drivers.feetech.table import TABLE


def ask(twin, packet, now=MS):
    """The answers to a packet, once all servos have waited their return delay."""
    parser = p.Parser()
    data = twin.receive(packet, now) + twin.work(now + 100 * MS)
    return parser.statuses(data)


def value(twin, id, name):
    register = TABLE[name]
    (status,) = ask(twin, p.read(id, register.address, register.size))
    return register.decode(status.data, register.address)


def put(twin, id, name, number):
    register = TABLE[name]
    return ask(twin, p.write(id, register.address, register.encode(number)))


def test_ping_tells_no_model_number_and_a_broadcast_is_answered_by_all():
    twin = make_twin()
    assert [(s.id, s.error, s.data) for s in ask(twin, p.ping(1))] == [(1, 0, b"")]
    assert [s.id for s in ask(twin, p.ping(p.BROADCAST))] == [1, 2]
    assert (value(twin, 1, "model_number"), value(twin, 2, "model_number")) == (2825, 777)


def test_the_state_as_delivered():
    twin = make_twin()
    found = {name: value(twin, 2, name) for name in ("return_delay_time", "lock", "torque_enable", "present_voltage")}
    assert found == {"return_delay_time": 250, "lock": 1, "torque_enable": 0, "present_voltage": 120}


def test_groups_answer_in_the_order_asked_and_stop_at_a_missing_servo():
    twin = make_twin()
    assert [s.id for s in ask(twin, p.group_read(56, 2, (2, 1)))] == [2, 1]
    assert [s.id for s in ask(twin, p.group_read(56, 2, (1, 7, 2)))] == [1]
    assert ask(twin, p.sync_write(42, 2, {1: b"\x00\x09", 2: b"\x64\x80"})) == []
    assert (value(twin, 1, "goal_position"), value(twin, 2, "goal_position")) == (0x900, -100)


def test_answers_wait_for_the_return_delay_and_collide_with_what_comes_too_soon():
    twin = make_twin()
    assert twin.receive(p.ping(1), MS) == b""
    assert twin.work(MS + 499_000) == b""
    assert twin.work(MS + 500_000) == p.status(1)
    twin.receive(p.ping(1), 2 * MS)
    assert twin.receive(p.ping(2), 2 * MS + 1) == b""
    assert twin.work(9 * MS) == b""
    assert twin.collisions == 1


def test_what_is_written_behind_the_lock_is_kept_only_while_it_is_open():
    twin = make_twin()
    servo = twin.servos[0]
    put(twin, 1, "return_delay_time", 3)
    assert servo.get("return_delay_time") == 3
    servo.restart()
    assert servo.get("return_delay_time") == 250
    put(twin, 1, "lock", 0)
    put(twin, 1, "return_delay_time", 3)
    servo.restart()
    assert (servo.get("return_delay_time"), servo.get("lock")) == (3, 1)


def test_read_only_registers_stay_and_are_counted():
    twin = make_twin()
    put(twin, 1, "present_position", 7)
    assert value(twin, 1, "present_position") == 2048
    put(twin, 1, "operating_mode", 3)
    assert value(twin, 1, "operating_mode") == 0
    assert twin.metrics()["refused"] == {"1.present_position": 1, "1.operating_mode": 1}


def test_the_status_level_silences_writes_only():
    twin = make_twin()
    put(twin, 1, "status_return_level", 0)
    assert put(twin, 1, "acceleration", 3) == []
    assert value(twin, 1, "acceleration") == 3
    assert [s.id for s in ask(twin, p.ping(1))] == [1]


def test_torque_on_drives_to_the_stored_goal():
    twin = make_twin()
    put(twin, 1, "goal_position", 2400)
    put(twin, 1, "torque_enable", 1)
    world = twin.bus.world
    world.advance(world.time + 1500 * MS)
    assert world.truth_arrays["arm_position"][0] == pytest.approx((2400 - 2048) * 2 * np.pi / 4096, abs=0.02)


def test_a_goal_beyond_the_limits_is_clipped():
    twin = make_twin()
    servo = twin.servos[0]
    servo.keep("max_position_limit", 2200)
    put(twin, 1, "goal_position", 4000)
    put(twin, 1, "torque_enable", 1)
    world = twin.bus.world
    world.advance(world.time + 1500 * MS)
    assert world.truth_arrays["arm_position"][0] == pytest.approx((2200 - 2048) * 2 * np.pi / 4096, abs=0.02)


def test_128_makes_the_present_position_2048():
    twin = make_twin()
    chain = twin.bus.chain
    chain._data.qpos[chain._q[0]] = 0.3
    chain.measure()
    put(twin, 1, "torque_enable", 128)
    assert value(twin, 1, "present_position") == 2048
    assert value(twin, 1, "homing_offset") == round(0.3 * 4096 / 2 / np.pi)
    assert value(twin, 1, "torque_enable") == 0


def test_wheel_mode_turns_and_stops():
    twin = make_twin()
    put(twin, 2, "operating_mode", 1)
    put(twin, 2, "goal_velocity", -1000)
    put(twin, 2, "torque_enable", 1)
    world = twin.bus.world
    world.advance(world.time + 1500 * MS)
    assert value(twin, 2, "present_velocity") == pytest.approx(-1000, abs=80)
    put(twin, 2, "goal_velocity", 0)
    world.advance(world.time + 1500 * MS)
    assert value(twin, 2, "present_velocity") == pytest.approx(0, abs=20)


def test_an_error_is_in_each_answer():
    twin = make_twin()
    twin.bus.chain.motors.fail(0, 32)
    assert [s.error for s in ask(twin, p.read(1, 56, 2))] == [32]
    assert value(twin, 1, "status") == 32
    put(twin, 1, "torque_enable", 1)
    put(twin, 1, "torque_enable", 0)
    assert value(twin, 1, "status") == 0


@cache
def one_twin():
    return make_twin()


_PIECES = st.one_of(
    st.binary(max_size=12),
    st.builds(p.packet, st.integers(0, 254), st.integers(0, 255), st.binary(max_size=20)),
    st.sampled_from([p.ping(1), b"\xff\xff", b"\xff\xff\xfe\xff", p.group_read(56, 15, (1, 2))]),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(_PIECES, max_size=8))
def test_no_bytes_end_a_twin(pieces):
    twin = one_twin()
    for k, piece in enumerate(pieces):
        twin.receive(piece, k * MS)
        twin.work(k * MS + 1)
    world = twin.bus.world
    world.advance(world.time + 2 * MS)
    assert np.isfinite(world.truth_arrays["arm_position"]).all()
