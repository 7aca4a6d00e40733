"""Quasi-direct-drive actuators: their law, their limits, their heat, and what a power-off takes from their encoder."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.sim.parts.actuators.models import MODELS
from srl.sim.parts.actuators.motors import (
    NOTHING,
    OFF,
    SILENCE_BIT,
    SLACK,
    STAGE_BIT,
    WINDING_BIT,
    ActuatorMotors,
    IdealMotors,
)

DT = 0.001


def motor(name: str = "DM4310", voltage: float = 24.0, position: float = 0.0, velocity: float = 0.0) -> ActuatorMotors:
    m = ActuatorMotors([MODELS[name]], voltage, DT)
    m.measure(np.array([position]), np.array([velocity]))
    m.switch(0, True)
    return m


def test_the_law_is_that_of_mit_mode() -> None:
    m = motor(position=0.2, velocity=1.5)
    m.kp[0], m.goal[0], m.kd[0], m.speed[0], m.feedforward[0] = 10, 0.5, 2, 1.0, -0.75
    assert m.step()[0] == pytest.approx(10 * 0.3 + 2 * -0.5 - 0.75)
    assert m.effort[0] == pytest.approx(1.25)


def test_a_drive_that_is_off_gives_nothing() -> None:
    m = motor()
    m.feedforward[0] = 3.0
    m.switch(0, False)
    assert m.step()[0] == 0.0


@given(st.floats(-500, 500), st.floats(-40, 40), st.sampled_from(sorted(MODELS)))
def test_torque_is_bounded_and_never_drives_above_the_no_load_speed(asked: float, speed: float, name: str) -> None:
    model = MODELS[name]
    m = motor(name, model.nominal_voltage, velocity=speed)
    m.feedforward[0] = asked
    torque = m.step()[0]
    assert abs(torque) <= model.peak_torque
    assert torque * speed <= 0 or abs(speed) < model.no_load_speed
    assert torque * asked >= 0


def test_a_brake_current_only_opposes_motion() -> None:
    for velocity, torque in ((2.0, -1.5), (-2.0, 1.5), (0.0, 0.0)):
        m = motor(velocity=velocity)
        m.brake[0] = 1.5
        assert m.step()[0] == torque


@pytest.mark.parametrize(("expiry", "on", "errors"), [(NOTHING, 1, 0), (OFF, 0, SILENCE_BIT), (SLACK, 1, 0)])
def test_silence_ends_as_the_firmware_has_it(expiry: int, on: int, errors: int) -> None:
    m = motor()
    m.timeout[0], m.expiry[0], m.feedforward[0] = 0.01, expiry, 2.0
    for _ in range(20):
        m.feed(0)
        assert m.step()[0] == 2.0
    for _ in range(15):
        m.step()
    assert (m.torque[0], m.errors[0]) == (on, errors)
    assert m.step()[0] == (2.0 if expiry == NOTHING else 0.0)


@pytest.mark.slow
def test_the_stall_torque_ends_in_heat_and_latches() -> None:
    m = motor()
    m.feedforward[0] = m.peak_torque[0]
    steps = 0
    while m.torque[0]:
        m.step()
        steps += 1
    assert 5 < steps * DT < 60
    assert int(m.errors[0]) & (WINDING_BIT | STAGE_BIT)
    m.switch(0, True)
    assert m.torque[0] == 0


@given(st.floats(-9, 9), st.sampled_from(["AK10-9", "DM4310"]))
def test_power_up_forgets_turns_of_the_encoder_and_no_more(angle: float, name: str) -> None:
    m, turn = motor(name), {"AK10-9": np.radians(40), "DM4310": 2 * np.pi}[name]
    m.measure(np.array([angle]), np.zeros(1))
    assert m.angle[0] == angle
    m.power_off(0)
    m.power_up(0)
    assert abs(m.angle[0]) <= turn / 2 + 1e-9
    off = (angle - m.angle[0]) / turn
    assert off == pytest.approx(round(off), abs=1e-9)
    assert m.torque[0] == 0


def test_a_state_comes_back() -> None:
    m = motor()
    m.kd[0], m.zero[0] = 1.0, 0.3
    saved = m.save()
    other = ActuatorMotors(m.models, m.voltage, DT)
    other.restore(saved)
    assert np.array_equal(other.save(), saved)
    assert other.kd[0] == 1.0


@given(st.floats(-500, 500), st.floats(-400, 400))
def test_an_ideal_drive_gives_what_it_is_asked_for(asked: float, speed: float) -> None:
    m = IdealMotors([MODELS["DM4310"]], 24.0, DT)
    m.measure(np.zeros(1), np.array([speed]))
    m.switch(0, True)
    m.feedforward[0] = asked
    for _ in range(3):
        assert m.step()[0] == pytest.approx(asked)
    assert m.effort[0] == pytest.approx(asked)
    assert not m.inertia.any()
    assert not m.drag.any()
    m.power_off(0)
    m.power_up(0)
    assert m.step()[0] == 0.0
