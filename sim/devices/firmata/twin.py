"""The twin of a Firmata board: a simulated Uno with StandardFirmata 2.5 on a serial line."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.sim.devices.firmata.fake import FakeFirmata
from srl.sim.devices.firmata.standard_firmata import BOOT, StandardFirmata
from srl.sim.devices.shared.serial import SerialTwin


class FirmataTwin(SerialTwin):
    """A simulated board; opening the port resets it, as on an Uno.

    At a reset servos go limp. The board identifies itself after `boot_delay`. What a client sends before that is
    lost.

    Attributes:
        boot_delay: s of the twin's clock; a real Uno takes 1.6 to 3.
    """

    def __init__(self, fake: FakeFirmata, boot_delay: float = 0.05) -> None:
        super().__init__(fake)
        self.board = fake
        self.boot_delay = boot_delay
        config = fake.config
        self._joints = tuple(config.servos)
        self._servo_of = {servo.pin: i for i, servo in enumerate(config.servos.values())}
        self._motor_of = {motor.pin: i for i, motor in enumerate(config.motors.values())}
        self._buttons = {button.pin: (i, button.pull_up) for i, button in enumerate(config.buttons.values())}
        self._analog = {entry.pin: name for name, entry in config.analog.items()}
        self._now = 0
        self._booted_at: int | None = None  # time at which the present boot ends
        self._commanded: int | None = None
        self._pulses: list[int | None] = [None] * len(self._joints)
        self._log: list[tuple[int, int, float]] = []
        self._duties: list[tuple[int, int, int]] = []
        self.firmware = StandardFirmata(self)

    def restart(self) -> None:
        """Resets the board without a client, as after a dip of its supply voltage."""
        for pin in self._servo_of:
            self.servo_detached(pin)
        self.board.reset()
        seen, too_long = self.firmware.seen, self.firmware.input.too_long
        self.firmware = StandardFirmata(self)
        self.firmware.seen, self.firmware.input.too_long = seen, too_long
        self._booted_at = self._now + round(self.boot_delay * 1e9)

    def connected(self, now: int) -> None:
        self._now = now
        self.restart()

    def receive(self, data: bytes, now: int) -> bytes:
        self._now = now
        return b"" if self._booted_at is not None else self.firmware.receive(data)

    def work(self, now: int) -> bytes:
        self._now = now
        if self._booted_at is None:
            return self.firmware.loop(self.board.world.time // 1_000_000)
        if now < self._booted_at:
            return b""
        self._booted_at = None
        return BOOT

    def metrics(self) -> dict[str, object]:
        """Adds to the serial twin's figures: messages by kind, pulse widths, time of a servo's last command.

        Pulse widths are in us by joint, None without pulses. The time is in ns of the twin's clock.
        """
        return (
            super().metrics()
            | {
                "messages": dict(self.firmware.seen),
                "too_long": self.firmware.input.too_long,
                "pulses_us": dict(zip(self._joints, self._pulses, strict=True)),
                "last_command_ns": self._commanded,
            }
            | self.board.felt.metrics(self.board.world.time)
        )

    def log(self) -> dict[str, NDArray[Any]]:
        """Adds the servo commands to the serial twin's log, repetitions included.

        `servo_ns` (k,): when each command came. `servo` (k,): the joint's number. `pulse_us` (k,): NaN where pulses
        ended. `duty_ns` (m,): when a motor got a duty, CLOCK_MONOTONIC. `motor`, `duty` (m,): its number, and of 255.
        """
        rows, duties = self._log, self._duties
        return super().log() | {
            "servo_ns": np.array([at for at, _, _ in rows], np.int64),
            "servo": np.array([joint for _, joint, _ in rows], np.int64),
            "pulse_us": np.array([us for _, _, us in rows], np.float64),
            "duty_ns": np.array([at for at, _, _ in duties], np.int64),
            "motor": np.array([motor for _, motor, _ in duties], np.int64),
            "duty": np.array([duty for _, _, duty in duties], np.int64),
        }

    # -- what is connected to the board's pins

    def servo_attached(self, pin: int, min_us: int, max_us: int, pulse_us: int) -> None:
        """A pin that isn't a servo of the profile drives nothing."""
        joint = self._servo_of.get(pin)
        if joint is not None:
            self.board.attach(joint, min_us, max_us)
            # The firmware stores widths by slot, not by pin, so this may be the last width of another servo.
            self.board.set_pulse(joint, pulse_us)
            self._note(joint, pulse_us)

    def servo_pulse(self, pin: int, pulse_us: int) -> None:
        joint = self._servo_of.get(pin)
        if joint is not None:
            self.board.set_pulse(joint, pulse_us)
            self._note(joint, pulse_us)

    def servo_detached(self, pin: int) -> None:
        joint = self._servo_of.get(pin)
        if joint is not None and self._pulses[joint] is not None:
            self.board.detach(joint)
            self._note(joint, None)

    def duty(self, pin: int, value: int) -> None:
        """A motor turns by it; other pins drive nothing."""
        if (motor := self._motor_of.get(pin)) is not None:
            self.board.felt.drive(motor, value / 255, self.board.world.time)
            self._commanded = self._now
            if self.keep_log:
                self._duties.append((time.monotonic_ns(), motor, value))

    def level(self, pin: int, pull_up: bool) -> bool:
        """A button connects its pin to ground; a pin without a pull-up reads 0."""
        if pin not in self._buttons:
            return pull_up
        number, board_pulls = self._buttons[pin]
        return not self.board.button(number) and (pull_up or not board_pulls)

    def reading(self, pin: int) -> int:
        """Nothing is wired to a pin that isn't an analog input of the profile; it reads 0."""
        name = self._analog.get(pin)
        return 0 if name is None else self.board.reading(name)

    def _note(self, joint: int, pulse: int | None) -> None:
        self._pulses[joint] = pulse
        self._commanded = self._now
        if self.keep_log:
            self._log.append((self._now, joint, float("nan") if pulse is None else float(pulse)))
