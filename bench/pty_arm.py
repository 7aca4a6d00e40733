"""The device of `stop_latency`: an arm of one joint at a pty, a byte for each command."""

from __future__ import annotations

import os
import time

import numpy as np

from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.signals import Command, Kind, Stop

COMMAND, STOP = b"C", b"S"
SETTLED = 10  # commands before a trial's fault

PROFILE = """
name: latency
rate: 100
devices:
  arm: {driver: pty-arm, port: PORT, spin: SPIN}
controllers:
  - {use: joint-setpoint, joints: [a], in: {target: client.q}, out: {q: arm.command}}
setpoints:
  client.q: {shape: [1], unit: rad, max_age: 0.5}
guard: {arm.command: {lower: -2, upper: 2, velocity: 1, acceleration: 10}}
"""


class PtyArmConfig(DeviceConfig):
    """`spin`: s that each `write` computes; below 0 for ever, once it has written `SETTLED` commands."""

    port: str
    spin: float = 0.0


class PtyArm(Driver):
    """Writes a byte for each command, and another one as its stop frame."""

    Config = PtyArmConfig
    config: PtyArmConfig

    def __init__(self, name: str, config: PtyArmConfig) -> None:
        super().__init__(name, config)
        self.commands = (
            Command(name="command", shape=(1,), unit="rad", kind=Kind.POSITION, stops=(Stop.HOLD,), period=0.02),
        )
        self.home = {"command": np.zeros(1)}
        self._descriptor = -1
        self._written = 0

    def open(self) -> None:
        """Opens the pty."""
        self._descriptor = os.open(self.config.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        self.health.opened()

    def read(self, now: int) -> None:
        """There is nothing to read."""

    def write(self, now: int) -> None:
        """Sends a command and computes for as long as it is told to."""
        os.write(self._descriptor, COMMAND)
        self.sent_arrays["command"][:] = self.command_arrays["command"]
        self._written += 1
        end = time.monotonic() + max(self.config.spin, 0.0)
        while time.monotonic() < end or (self.config.spin < 0 and self._written > SETTLED):
            pass

    def stop(self, category: Stop) -> None:
        """Sends the stop frame."""
        os.write(self._descriptor, STOP)

    def close(self) -> None:
        """Closes the pty."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1

    def fileno(self) -> int | None:
        return self._descriptor

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        return (STOP,)
