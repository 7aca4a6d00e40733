"""The twin of vibration motors: a simulated Uno with StandardFirmata 2.5 on a serial line."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.drivers.vibration_motors.config import FULL
from srl.sim.devices.firmata.board import BoardTwin
from srl.sim.devices.vibration_motors.fake import FakeVibrationMotors


class VibrationMotorsTwin(BoardTwin):
    """A simulated board that feeds the motors: they are off while its port is gone."""

    def __init__(self, fake: FakeVibrationMotors, boot_delay: float = 0.05) -> None:
        self.board = fake
        self._motor_of = {motor.pin: i for i, motor in enumerate(fake.config.motors.values())}
        self._duties: list[tuple[int, int, int]] = []
        super().__init__(fake, boot_delay)

    def reset_pins(self) -> None:
        self.board.off()

    def close(self) -> None:
        super().close()
        self.reset_pins()

    def duty(self, pin: int, value: int) -> None:
        """A motor turns by it; other pins drive nothing."""
        if (motor := self._motor_of.get(pin)) is not None:
            self.board.felt[motor].drive(value / FULL, self.board.world.time)
            if self.keep_log:
                self._duties.append((time.monotonic_ns(), motor, value))

    def metrics(self) -> dict[str, object]:
        """Adds to the board's figures what the wearer has felt of each motor, and the vibration now."""
        return super().metrics() | self.board.metrics()

    def log(self) -> dict[str, NDArray[Any]]:
        """Adds each duty to the serial twin's log, repetitions included.

        `duty_ns` (k,): when it came, CLOCK_MONOTONIC. `motor` (k,): the motor's number. `duty` (k,): of 255.
        """
        names = ("duty_ns", "motor", "duty")
        return super().log() | {
            name: np.array([row[i] for row in self._duties], np.int64) for i, name in enumerate(names)
        }
