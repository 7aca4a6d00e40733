"""A joint's seat from two known angles: whatever is hidden is found, and what can't be a servo's is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.commissioning.calibration.servos.fit import HornFit, ServoError, Thresholds, horn_fit, refusals
from srl.drivers.dynamixel.config import MotorConfig
from srl.drivers.firmata.config import ServoConfig
from srl.runtime.contracts.servo_record import SHARE, TRIM, Line

ANGLE = st.floats(-1.2, 1.2)
DIRECTION = st.sampled_from([-1, 1])
HIDDEN = st.builds(
    HornFit, st.floats(-TRIM, TRIM), DIRECTION, st.floats(1 - SHARE, 1 + SHARE), st.just(True), st.floats(-1.5, 1.5)
)


@given(HIDDEN, ANGLE, st.floats(0.5, 1.5), DIRECTION, ANGLE)
def test_two_known_angles_find_trim_sense_and_scale(
    hidden: HornFit, first: float, apart: float, way: int, q: float
) -> None:
    second = first + way * apart
    n = hidden.entry(first), hidden.entry(second)
    found = horn_fit(n, first, second, hidden.mirror, False, 0.25)
    assert found.known
    assert found.direction == hidden.direction
    assert found.joint(hidden.entry(q)) == pytest.approx(q, abs=1e-9)
    assert found.entry(found.joint(q)) == pytest.approx(q, abs=1e-9)


@given(st.floats(-TRIM, TRIM), DIRECTION, st.floats(-1.5, 1.5), ANGLE, st.floats(0.3, 1.5))
def test_a_known_angle_and_the_positive_side_find_trim_and_sense(
    trim: float, direction: int, mirror: float, first: float, apart: float
) -> None:
    hidden = HornFit(trim, direction, 1.0, False, mirror)
    n = hidden.entry(first), hidden.entry(first + apart)
    found = horn_fit(n, first, None, mirror, False, 0.25)
    assert (found.direction, found.scale, found.known) == (direction, 1.0, False)
    assert found.trim == pytest.approx(trim, abs=1e-9)


@given(st.floats(-0.4, 0.4), DIRECTION, st.floats(0.8, 1.2), ANGLE, st.booleans(), st.integers(-50, 50))
def test_a_calibrated_servo_goes_where_the_seat_says_and_keeps_its_pulses(
    trim: float, direction: int, scale: float, q: float, turned: bool, trim_us: int
) -> None:
    servo = ServoConfig(
        pin=9, min_us=900, max_us=2100, lower=-1.5, upper=1.0, reversed=turned, home=0.0, trim_us=trim_us
    )
    line = Line(trim=trim, direction=direction, scale=scale, known=True, entry=servo.entry)  # type: ignore[arg-type]
    made, old = servo.calibrated(line).calibration, servo.calibration
    n = HornFit(trim, direction, scale, True, servo.mirror).entry(q)
    assert made.zero_us + made.us_per_rad * q == pytest.approx(old.zero_us + old.us_per_rad * n, abs=1e-6)
    assert (made.shortest, made.longest) == (old.shortest, old.longest)


@given(st.floats(-TRIM, TRIM), DIRECTION, st.booleans(), st.floats(-3, 3), st.floats(-3, 3))
def test_a_calibrated_axis_of_a_bus_shows_what_the_seat_says(
    trim: float, direction: int, turned: bool, zero: float, shaft: float
) -> None:
    axis = MotorConfig(id=1, model="MX-28", reversed=turned, zero=zero)
    line = Line(trim=trim, direction=direction, scale=1.0, known=False, entry=axis.entry)  # type: ignore[arg-type]
    made = axis.calibrated(line)
    n = axis.scale * (shaft - axis.zero)
    expected = HornFit(trim, direction, 1.0, False, axis.mirror).joint(n)
    assert made.scale * (shaft - made.zero) == pytest.approx(expected, abs=1e-9)


def test_what_can_be_no_servo_s_is_refused() -> None:
    limits, reach = Thresholds(), (-1.6, 1.6)

    def refused(found: HornFit, second: float | None = None, home: float | None = 0.0) -> str:
        return " ".join(str(r) for r in refusals("tip", found, (0.0, 1.0), second, home, reach, limits))

    assert refused(HornFit(0.2, 1, 1.1, True)) == ""
    assert "its trim is 0.70 rad, 0.6 are allowed. Seat the horn anew" in refused(HornFit(0.7))
    assert "its scale is 0.70, off by more than 25%" in refused(HornFit(0.0, 1, 0.7, True))
    assert "its home, 1.5 rad, is out of its reach, -1.90 to 1.30" in refused(HornFit(0.3), home=1.5)
    assert "its servo measured 1.00 rad where you gave 0.80, off by 0.20" in refused(HornFit(), 0.8, None)
    with pytest.raises(ServoError, match=r"they differ by 0.10 rad, 0.25 are needed"):
        horn_fit((0.0, 0.1), 0.0, None, 0.0, False, 0.25)
