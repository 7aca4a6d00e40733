"""Options of a Firmata board, and angles to pulses and back."""

import numpy as np
import pytest
from helpers.firmata import firmata, servo
from hypothesis import assume, given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.drivers.firmata import Firmata
from srl.drivers.firmata.config import ServoConfig
from srl.runtime.contracts.servo_record import Line
from srl.runtime.contracts.signals import Kind, Stop


@st.composite
def servos(draw):
    lower = draw(st.floats(-4, 4))
    upper = lower + draw(st.floats(0.1, 6))
    min_us = draw(st.integers(544, 2300))
    max_us = draw(st.integers(min_us + 50, 2400))
    trim = draw(st.integers(-40, 40))
    assume(max_us + trim > 560)
    assume(min_us + trim < 2390)
    turned = draw(st.booleans())
    middle = dict(lower=lower, upper=upper, home=(lower + upper) / 2)
    try:
        return ServoConfig(pin=9, min_us=min_us, max_us=max_us, trim_us=trim, reversed=turned, **middle)
    except ValidationError:
        assume(False)


@given(servos(), st.floats(0, 1))
def test_angle_and_pulse_are_inverse_within_half_a_microsecond(config, where):
    one = config.calibration
    pulse = round(one.shortest + where * (one.longest - one.shortest))
    assert one.pulse(one.angle(pulse)) == pulse
    angle = one.lower + where * (one.upper - one.lower)
    assert abs(one.angle(one.pulse(angle)) - angle) <= 0.5001 / abs(one.us_per_rad)


@given(servos(), st.floats(allow_nan=False, allow_infinity=False))
def test_no_angle_gives_a_pulse_outside_the_servo_or_one_the_board_takes_for_degrees(config, angle):
    one = config.calibration
    assert 544 <= one.shortest <= one.pulse(angle) <= one.longest <= 2400


@given(servos())
def test_the_ends_of_the_travel(config):
    one = config.calibration
    at_min, at_max = (config.upper, config.lower) if config.reversed else (config.lower, config.upper)
    assert one.us_per_rad * at_min + one.zero_us == pytest.approx(config.min_us + config.trim_us)
    assert one.us_per_rad * at_max + one.zero_us == pytest.approx(config.max_us + config.trim_us)
    assert (one.us_per_rad < 0) == config.reversed


def test_a_trim_shifts_every_pulse_and_takes_from_the_reach_what_it_pushes_out():
    plain = ServoConfig(**servo(9)).calibration
    trimmed = ServoConfig(**servo(9, trim_us=30)).calibration
    assert trimmed.pulse(1.5) == plain.pulse(1.5) + 30
    assert (trimmed.shortest, trimmed.longest) == (574, 2400)
    assert trimmed.lower == pytest.approx(0)
    assert trimmed.upper == pytest.approx(3.0 - 30 / trimmed.us_per_rad)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({}, "neither servos nor buttons"),
        ({"servos": {"a": servo(9, min_us=500)}}, "greater than or equal to 544"),
        ({"servos": {"a": servo(9, max_us=2500)}}, "less than or equal to 2400"),
        ({"servos": {"a": servo(9, min_us=2000, max_us=1000)}}, "must be less than max_us"),
        ({"servos": {"a": servo(9, lower=3.0, upper=0.0)}}, "reversed: true"),
        ({"servos": {"a": servo(9, home=3.1)}}, "outside the servo's reach"),
        ({"servos": {"a": servo(9, min_us=600, max_us=700, trim_us=-300)}}, "leaves no pulses"),
        ({"servos": {"a": servo(9, home=float("nan"))}}, "finite"),
        ({"servos": {"a": servo(9), "b": servo(9)}}, "pin 9 is used twice, by a and b"),
        ({"servos": {"a": servo(9)}, "buttons": {"go": {"pin": 9}}}, "pin 9 is used twice, by a and go"),
        ({"servos": {f"j{pin}": servo(pin) for pin in range(2, 15)}}, "at most 12"),
        ({"buttons": {"go": {"pin": 2, "colour": "red"}}}, "Extra inputs"),
        ({"buttons": {"go": {"pin": 2, "debounce": -1}}}, "greater than or equal to 0"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, complaint):
    with pytest.raises(ValidationError, match=complaint):
        Firmata.Config(port="/dev/null", **options)


def test_what_the_driver_declares():
    driver = firmata(
        "/dev/null",
        servos={"base": servo(9), "tip": servo(10, lower=-1.0, upper=1.0, home=0.2, reversed=True)},
        buttons={"go": {"pin": 2}, "halt": {"pin": 3}, "menu": {"pin": 4}},
    )
    (command,), (state,) = driver.commands, driver.states
    assert (command.name, command.shape, command.unit, command.labels) == (
        "position_command", (2,), "rad", ("base", "tip"),
    )  # fmt: skip
    assert (command.kind, command.feedback) == (Kind.POSITION, None)
    assert command.stops == (Stop.HOLD, Stop.RETRACT, Stop.LIMP)
    assert (state.name, state.shape, state.unit, state.labels) == (
        "buttons",
        (3,),
        "1",
        ("go", "halt", "menu"),
    )
    np.testing.assert_allclose(driver.home["position_command"], [1.5, 0.2])
    limits = driver.limits["position_command"]
    np.testing.assert_allclose(limits.lower, [0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(limits.upper, [3.0, 1.0])


def test_a_board_without_servos_declares_no_commands():
    driver = firmata("/dev/null", buttons={"go": {"pin": 2}})
    assert driver.commands == ()
    assert driver.limits == {}
    assert driver.home == {}
    assert driver.fileno() is None


@pytest.mark.parametrize("pin", [-1, 0, 1, 20, 25, 99, 128])
def test_a_pin_that_such_a_board_does_not_have_is_refused(pin):
    """0 and 1 are its serial line."""
    for options in ({"servos": {"a": servo(pin)}}, {"buttons": {"go": {"pin": pin}}}):
        with pytest.raises(ValidationError, match=r"an ATmega328P board .* 2 to 13, and A0 to A5"):
            Firmata.Config(port="loop://board", **options)


@pytest.mark.parametrize("pin", [2, 13, 14, 19])
def test_the_first_and_last_pins_are_taken(pin):
    assert Firmata.Config(port="loop://board", servos={"a": servo(pin)}).servos["a"].pin == pin


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("trim", "scale"), [(0.0, 1.0), (0.2, 1.0), (-0.3, 0.8)])
def test_a_calibration_says_what_the_joints_angle_is_at_each_pulse(direction, turned, trim, scale):
    """The trim is the profile's angle where the joint is at 0, with the sense of rotation that was found."""
    config = ServoConfig(pin=9, min_us=700, max_us=2300, lower=-1.2, upper=1.6, home=0.0, reversed=turned)
    line = Line(trim=trim, direction=direction, scale=scale, known=True, entry=config.entry)
    one, found = config.calibration, config.calibrated(line).calibration
    assert (found.shortest, found.longest) == (one.shortest, one.longest)
    for pulse in (700, 1234, 2300):
        sensed = one.angle(pulse) if direction > 0 else config.mirror - one.angle(pulse)
        assert found.angle(pulse) == pytest.approx(scale * (sensed - trim))
