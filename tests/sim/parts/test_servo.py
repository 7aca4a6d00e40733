"""The servos' physics: a torque-speed line, a dead band, limpness."""

import numpy as np
import pytest
from helpers.sim import MS, world
from hypothesis import given
from hypothesis import strategies as st

from srl.sim.parts.hand.servo import ServoBank

STILL = {"gravity": (0, 0, 0), "wearer": {"period": 1000.0}}


def step_response(target, servo, cycles=600):
    """Positions, speeds and torques (cycles,) of the last joint, ms by ms after a step from zero."""
    w = world(fingers=[{"servo": servo}], **STILL)
    for i in range(4):
        w.set_servo(i, 0.0)
    w.advance(100 * MS)
    w.set_servo(3, target)
    rows = []
    for _ in range(cycles):
        w.advance(w.time + MS)
        rows.append([w.truth_arrays[name][3] for name in ("finger_position", "finger_velocity", "finger_effort")])
    return np.array(rows).T


@pytest.mark.parametrize("no_load_speed", [5.0, 8.0, 10.0])
def test_a_step_is_followed_at_about_the_no_load_speed(no_load_speed):
    q, v, _ = step_response(1.4, {"no_load_speed": no_load_speed})
    assert 0.8 * no_load_speed < v.max() < no_load_speed
    assert q[-1] == pytest.approx(1.4, abs=0.01)
    assert q.max() < 1.4 + 0.06
    assert np.abs(np.diff(q)).max() < no_load_speed * 1e-3  # never a jump


def test_torque_is_limited_and_falls_with_speed():
    servo = {"stall_torque": 0.14, "no_load_speed": 8.0}
    _, v, effort = step_response(1.4, servo)
    assert np.abs(effort).max() <= 0.14 + 1e-9
    driving = effort * v > 0
    assert (np.abs(effort[driving]) <= 0.14 * (1 - np.abs(v[driving]) / 8.0) + 2e-3).all()


def test_a_servo_too_weak_for_its_load_stalls():
    # Gravity of 10 g along the lever of the whole finger: three modules of 15 g, 0.14 N m is too little.
    w = world(gravity=(0, -98.1, 0), wearer={"period": 1000.0})
    for i in range(4):
        w.set_servo(i, 0.0)
    w.advance(1000 * MS)
    assert w.finger_position()[1] < -0.3
    assert abs(w.truth_arrays["finger_effort"][1]) == pytest.approx(0.14, abs=0.01)


def test_without_pulses_a_servo_is_limp_and_with_them_it_holds():
    w = world(gravity=(0, 9.81, 0), wearer={"period": 1000.0})  # pulls the finger toward the fingers
    w.advance(1000 * MS)
    assert np.isnan(w.servo_targets()).all()
    assert w.finger_position()[1] > 0.9
    for i in range(4):
        w.set_servo(i, 0.0)
    w.advance(2000 * MS)
    np.testing.assert_allclose(w.finger_position(), 0.0, atol=0.03)
    for i in range(4):
        w.set_servo(i, None)
    w.advance(3000 * MS)
    assert w.finger_position()[1] > 0.9


def test_a_pulse_takes_effect_when_it_is_due_and_not_before():
    w = world(**STILL)
    w.set_servo(3, 0.0)
    w.advance(100 * MS)
    w.set_servo(3, 0.5, at=123 * MS)
    w.advance(122 * MS)
    assert w.servo_targets()[3] == 0.0
    assert abs(w.finger_position()[3]) < 1e-3
    w.advance(140 * MS)
    assert w.servo_targets()[3] == 0.5
    assert w.finger_position()[3] > 0.01


@given(st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=30), st.floats(0.0, 0.2))
def test_the_held_target_is_within_the_dead_band_of_the_last_command(commands, band):
    bank = ServoBank(np.array([band]))
    for step, command in enumerate(commands):
        before = bank.held[0]
        bank.command(0, command, step)
        changed = bank.latch(step)
        assert changed == (bank.held[0] != before) or command == before
        assert bank.held[0] == (before if abs(command - before) < band else command)
        assert abs(bank.held[0] - command) <= band


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 2), st.floats(-1, 1)), max_size=20))
def test_of_several_words_for_one_instant_the_last_counts(words):
    bank = ServoBank(np.zeros(3))
    for step, servo, target in words:
        bank.command(servo, target, step)
    expected = np.full(3, np.nan)
    for step in range(21):
        for at, servo, target in words:
            if at == step:
                expected[servo] = target
        saved = bank.save()
        bank.latch(step)
        np.testing.assert_array_equal(bank.held, expected)
        other = ServoBank(np.zeros(3))
        other.restore(saved)
        other.latch(step)
        np.testing.assert_array_equal(other.save(), bank.save())
    assert bank.next_step() is None
