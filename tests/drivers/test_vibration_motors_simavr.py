"""Vibration motors on the real firmware, which runs in simavr."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.motor_board import MOTORS, vibration_motors
from helpers.wait import until

from srl.drivers.vibration_motors.config import MotorConfig
from srl.runtime.contracts.signals import Stop

sys.path.insert(0, str(Path(__file__).parents[1] / "simavr"))
from board import Board

PERIOD = 1024.0  # us, of timer 0


@pytest.mark.slow
def test_the_real_firmware_gives_these_duties_confirms_them_and_its_stop_frame_ends_them(tmp_path: Path) -> None:
    def share(pin: int) -> float:
        """Of the time that it is high; an output that never changes is at its level."""
        real.wait(0.02)
        real.pin(pin)
        real.wait(0.02)
        look = real.pin(pin)
        return look.last_us / PERIOD if look.pulses and look.max_us else float(look.high)

    with Board(tmp_path) as real:
        driver = vibration_motors(real.port)
        driver.open()
        sent = driver.sent_arrays["intensity_command"]

        def cycle() -> None:
            driver.read(time.monotonic_ns())
            driver.write(time.monotonic_ns())

        def confirmed() -> bool:
            return driver.health.stamp > asked and np.allclose(sent, driver.command_arrays["intensity_command"])

        for wrist, elbow in ((0.5, 0.25), (1.0, 0.75), (0.1, 1.0), (0.0, 0.3)):
            driver.command_arrays["intensity_command"][:] = wrist, elbow
            sent.fill(np.nan)
            asked = time.monotonic_ns()
            until(confirmed, cycle)
            assert share(5) == pytest.approx(MotorConfig.model_validate(MOTORS["wrist"]).duty_of(wrist) / 255, abs=0.01)
            assert share(6) == pytest.approx(elbow, abs=0.01)
        assert driver.metrics()["unconfirmed"] == 0
        link = driver._link
        assert link is not None
        link.write_all(b"".join(driver.stop_frames(Stop.OFF)), 1.0)  # as the supervisor does it
        until(lambda: share(5) == share(6) == 0.0)
        driver.close()
