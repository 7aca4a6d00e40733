"""The twin of a Firmata board: a simulated Uno with StandardFirmata 2.5 on a serial line."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.sim.devices.firmata.board import BoardTwin
from srl.sim.devices.firmata.fake import FakeFirmata


class FirmataTwin(BoardTwin):
    """A simulated board; at a reset servos go limp."""

    def __init__(self, fake: FakeFirmata, boot_delay: float = 0.05) -> None:
        self.board = fake
        config = fake.config
        self._joints = tuple(config.servos)
        self._servo_of = {servo.pin: i for i, servo in enumerate(config.servos.values())}
        self._buttons = {button.pin: (i, button.pull_up) for i, button in enumerate(config.buttons.values())}
        self._analog = {entry.pin: name for name, entry in config.analog.items()}
        self._commanded: int | None = None
        self._pulses: list[int | None] = [None] * len(self._joints)
        self._log: list[tuple[int, int, float]] = []
        super().__init__(fake, boot_delay)

    def reset_pins(self) -> None:
        for pin in self._servo_of:
            self.servo_detached(pin)
        self.board.reset()

    def metrics(self) -> dict[str, object]:
        """Adds to the board's figures: pulse widths, time of a servo's last command.

        Pulse widths are in us by joint, None without pulses. The time is in ns of the twin's clock.
        """
        return super().metrics() | {
            "pulses_us": dict(zip(self._joints, self._pulses, strict=True)),
            "last_command_ns": self._commanded,
        }

    def log(self) -> dict[str, NDArray[Any]]:
        """Adds the servo commands to the serial twin's log, repetitions included.

        `servo_ns` (k,): when each command came. `servo` (k,): the joint's number. `pulse_us` (k,): NaN where pulses
        ended.
        """
        rows = self._log
        return super().log() | {
            "servo_ns": np.array([at for at, _, _ in rows], np.int64),
            "servo": np.array([joint for _, joint, _ in rows], np.int64),
            "pulse_us": np.array([us for _, _, us in rows], np.float64),
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
