"""An Uno with StandardFirmata on a link that can lose bytes, and the driver of its motors, without a clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from srl.drivers.transport import Transport
from srl.drivers.vibration_motors import VibrationMotors
from srl.sim.devices.firmata.standard_firmata import BOOT, OUTPUT, PINS, StandardFirmata, Wires

MOTORS: dict[str, dict[str, Any]] = {"wrist": {"pin": 5, "start": 0.25, "full": 0.75}, "elbow": {"pin": 6}}
STEP = 10_000_000  # ns of a cycle


def keep(data: bytes) -> bytes:
    """Nothing is lost."""
    return data


class MotorBoard(Transport, Wires):
    """The link to the board; `heard` and `answered` change what passes in each direction.

    Attributes:
        late: ns from what the board is sent to its answers.
        now: ns; `Rig` sets it.
        pwm: the duties that pins have now, 0 to 255.
        received: the bytes that the board got.
    """

    def __init__(self) -> None:
        super().__init__("test", "cuff")
        self.heard: Callable[[bytes], bytes] = keep
        self.answered: Callable[[bytes], bytes] = keep
        self.pwm = [0] * PINS
        self.received = b""
        self.late = self.now = 0
        self._coming: list[tuple[int, bytes]] = []  # ns when it is there
        self.firmware = StandardFirmata(self)

    def restart(self, banner: bytes = BOOT) -> None:
        """After a dip of its supply."""
        self.pwm = [0] * PINS
        self.firmware = StandardFirmata(self)
        self._coming.append((self.now, banner))

    # -- the link

    def read_wait(self, timeout_s: float) -> bytes:
        return self.read()

    def fileno(self) -> int:
        return -1

    def _take(self, most: int) -> bytes:
        if not self._coming or self._coming[0][0] > self.now:
            raise BlockingIOError
        due, data = self._coming.pop(0)
        if data[most:]:
            self._coming.insert(0, (due, data[most:]))
        return data[:most]

    def _give(self, data: bytes) -> int:
        passed = self.heard(data)
        self.received += passed
        if answer := self.answered(self.firmware.receive(passed)):
            self._coming.append((self.now + self.late, answer))
        return len(data)

    def _queued(self) -> int:
        return 0

    def _shut(self) -> None: ...

    # -- the pins

    def duty(self, pin: int, value: int) -> None:
        self.pwm[pin] = value

    @property
    def on(self) -> bool:
        """Whether a motor turns; a pin that isn't PWM is low unless somebody has written 1. Others have no motor."""
        f, pins = self.firmware, [motor["pin"] for motor in MOTORS.values()]
        return any(self.pwm[pin] or (f._mode[pin] == OUTPUT and f._state[pin]) for pin in pins)


def vibration_motors(port: str = "/dev/null", **options: Any) -> VibrationMotors:
    """A driver with its arrays bound, closed."""
    driver = VibrationMotors("cuff", VibrationMotors.Config.model_validate({"port": port, "motors": MOTORS} | options))
    driver.bind({}, {"intensity_command": np.zeros(len(driver.config.motors))})
    return driver


class Rig:
    """The driver in cycles, of 10 ms if nothing else is said."""

    def __init__(self, driver: VibrationMotors, board: MotorBoard, step: int = STEP) -> None:
        self.driver, self.board, self.step, self.now = driver, board, step, 0

    def cycle(self, *levels: float) -> None:
        """One with a command; without `levels` one in which the device isn't active."""
        self.now = self.board.now = self.now + self.step
        self.driver.read(self.now)
        if levels:
            self.driver.command_arrays["intensity_command"][:] = levels
            self.driver.write(self.now)

    def run(self, seconds: float, *levels: float) -> None:
        for _ in range(round(seconds * 1e9 / self.step)):
            self.cycle(*levels)

    @property
    def age(self) -> float:
        """s, of the newest confirmation."""
        return (self.now - self.driver.health.stamp) * 1e-9
