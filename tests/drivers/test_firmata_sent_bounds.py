"""What a Firmata board's driver says it has sent is the angle of the pulse: never beyond the servo's reach."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.firmata import ScriptedBoard, firmata, servo
from helpers.wait import until

from srl.drivers.firmata import Firmata

MS = 1_000_000
# 0 to 3 rad; the same the other way round; and one whose trim takes 0.16 rad of its reach.
SERVOS = {"plain": servo(9), "reversed": servo(10, reversed=True), "trimmed": servo(11, trim_us=100)}


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Firmata]:
    with ScriptedBoard(tmp_path) as board:
        driver = firmata(board.port, servos=SERVOS)
        driver.open()
        yield driver
        driver.close()


def send(driver: Firmata, *angles: float) -> list[float]:
    """What is reported once the board has taken them."""
    sent, now = driver.sent_arrays["position_command"], iter(range(10**12, 2 * 10**12, 10 * MS))
    sent.fill(np.nan)

    def cycle() -> None:
        at = next(now)
        driver.read(at)
        driver.command_arrays["position_command"][:] = angles
        driver.write(at)

    until(lambda: bool(np.isfinite(sent[np.isfinite(angles)]).all()), cycle)
    found: list[float] = sent.tolist()
    return found


@pytest.mark.parametrize("much", [3.2, 9.0, 1e12, 1e300])
def test_angles_beyond_a_servo_s_reach_are_reported_as_its_end(opened: Firmata, much: float) -> None:
    ends = [calibration.upper for calibration in opened.calibrations]
    assert ends == pytest.approx([3.0, 3.0, 3.0 - 100 * 3 / 1856])
    assert send(opened, much, much, much) == ends
    assert send(opened, -much, -much, -much) == [calibration.lower for calibration in opened.calibrations]


def test_reported_angles_are_those_of_the_pulses(opened: Firmata) -> None:
    rng = np.random.default_rng(0)
    for angles in rng.uniform(-1.0, 4.0, (20, 3)):
        sent = send(opened, *angles)
        pulses = opened.metrics()["pulses_us"]
        assert isinstance(pulses, dict)
        for angle, pulse, calibration in zip(sent, pulses.values(), opened.calibrations, strict=True):
            assert calibration.shortest <= pulse <= calibration.longest
            assert abs(calibration.angle(pulse) - angle) <= 0.51 / abs(calibration.us_per_rad)


def test_an_angle_that_is_none_is_not_reported(opened: Firmata) -> None:
    send(opened, 1.0, 1.0, 1.0)
    assert send(opened, 2.0, np.nan, 9.0)[0] == 2.0
    assert np.isnan(opened.sent_arrays["position_command"][1])
