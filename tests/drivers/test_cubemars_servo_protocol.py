"""CubeMars servo mode: golden vectors of public software, and properties.

Commands: ak-c-drivers and cubemars-servo-can; status: those and TMotorCANControl (protocol sheet can_actuators).
"""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.cubemars_servo import protocol
from srl.drivers.cubemars_servo.config import ServoAxis
from srl.drivers.cubemars_servo.driver import Scale
from srl.drivers.cubemars_servo.models import MODELS

AXIS = {
    "id": 1, "model": "AK80-9", "parked": 0.0, "lower": -2.0, "upper": 2.0, "velocity": 5.0, "acceleration": 50.0,
    "current": 20.0, "torque_constant": 0.8,
}  # fmt: skip


@pytest.mark.parametrize(
    ("message", "identifier", "data"),
    [
        (protocol.current(1, 5.0), 0x101, "00001388"),
        (protocol.current(1, -5.0), 0x101, "ffffec78"),
        (protocol.brake(1, 5.0), 0x201, "00001388"),
        (protocol.brake(1, -5.0), 0x201, "00001388"),
        (protocol.speed(1, 1000), 0x301, "000003e8"),
        (protocol.speed(1, -5000), 0x301, "ffffec78"),
        (protocol.position(1, 180.0, 5000, 30000), 0x601, "001b774001f40bb8"),
        (protocol.current(104, 0.0), 0x168, "00000000"),
    ],
)
def test_golden_commands(message, identifier, data):
    assert message.is_extended_id
    assert (message.arbitration_id, bytes(message.data).hex()) == (identifier, data)


def test_a_speed_goes_in_tens():
    """cubemars-servo-can 0.4.0 sends 5000 as 5000: fifty thousand electrical rpm."""
    assert bytes(protocol.position(1, 180.0, 5000, 30000).data).hex() != "001b774013887530"


def test_golden_status():
    assert protocol.status(bytes.fromhex("0384ff9c01f42d00")) == protocol.Status(90.0, -1000.0, 5.0, 45, 0)
    found = protocol.status(bytes.fromhex("fc7c012cfe0c1e06"))
    assert found == protocol.Status(-90.0, 3000.0, -5.0, 30, 6)
    assert "power stage" in protocol.in_words(found.error)


@given(st.floats(-1e5, 1e5), st.floats(0, 1e7), st.floats(0, 1e7))
def test_whatever_is_asked_stays_in_its_field(degrees, erpm, ramp):
    place, speed, acceleration = struct.unpack(">ihh", protocol.position(1, degrees, erpm, ramp).data)
    assert place / 10_000 == pytest.approx(max(-3200, min(3200, degrees)), abs=5e-5)
    assert 1 <= speed <= 32767
    assert 1 <= acceleration <= 32767


@given(st.floats(-1e4, 1e4))
def test_a_current_is_bounded(amperes):
    (value,) = struct.unpack(">i", protocol.current(1, amperes).data)
    assert abs(value / 1000 - max(-60, min(60, amperes))) < 5.001e-4
    (value,) = struct.unpack(">i", protocol.brake(1, amperes).data)
    assert 0 <= value <= 60_000


@given(st.binary(max_size=9))
def test_any_bytes_are_a_status_or_none(data):
    assert (protocol.status(data) is None) == (len(data) != 8)


@pytest.mark.parametrize("error", range(256))
def test_every_error_has_words(error):
    assert bool(protocol.in_words(error)) == bool(error)


@given(st.sampled_from(sorted(MODELS)), st.booleans(), st.floats(-2, 2), st.floats(-2, 2), st.floats(-20, 20))
def test_units_come_back(model, reversed_, zero, position, velocity):
    scale = Scale(ServoAxis.model_validate(AXIS | {"model": model, "reversed": reversed_, "zero": zero}))
    assert scale.position(scale.degrees(position)) == pytest.approx(position, abs=1e-9)
    assert scale.velocity(scale.sign * velocity * scale.erpm) == pytest.approx(velocity, abs=1e-9)


def test_the_electrical_speed_of_a_model():
    """One turn of the shaft a second: 60 rpm, times the gear, times the pole pairs."""
    assert MODELS["AK80-9"].erpm * 2 * 3.141592653589793 == pytest.approx(60 * 9 * 21)
    assert MODELS["AK60-6"].erpm * 2 * 3.141592653589793 == pytest.approx(60 * 6 * 14)


def test_nothing_here_moves_the_origin():
    made = [name for name in vars(protocol) if "origin" in name.lower()]
    assert made == []
