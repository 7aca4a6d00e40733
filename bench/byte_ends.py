"""The devices of `byte_to_byte`: sensor and actuator of one joint, each at an open socket, in frames of 10 bytes."""

from __future__ import annotations

import contextlib
import math
import os
import struct
from typing import Final

import numpy as np

from srl.runtime.contracts.driver import DeviceConfig, Driver, Sensor
from srl.runtime.contracts.signals import Command, Kind, Signal, Stop

_FRAME: Final = struct.Struct("<BdB")  # mark, value, sum of the value's bytes
_MARK: Final = 0xA5

PROFILE: Final = """
name: byte-to-byte
rate: {rate}
devices:
  handle: {{driver: byte-handle, port: "{sensor}"}}
  arm: {{driver: byte-arm, port: "{actuator}"}}
controllers:
  - {{use: joint-setpoint, joints: [a], in: {{target: handle.position}}, out: {{q: arm.command}}}}
guard: {{arm.command: {{lower: -2, upper: 2, velocity: 10, acceleration: 10000}}}}
"""


def frame(value: float) -> bytes:
    """Returns the frame of a value, rad."""
    return _FRAME.pack(_MARK, value, sum(struct.pack("<d", value)) & 255)


def values(buffer: bytes) -> tuple[list[float], bytes]:
    """Returns the values of the whole frames, and the bytes that are left."""
    found, at = [], 0
    while len(buffer) - at >= _FRAME.size:
        mark, value, total = _FRAME.unpack_from(buffer, at)
        if mark == _MARK and sum(buffer[at + 1 : at + 9]) & 255 == total:
            found.append(value)
            at += _FRAME.size
        else:
            at += 1
    return found, buffer[at:]


class EndConfig(DeviceConfig):
    """`port`: the number of an open socket that doesn't block."""

    port: str


class Handle(Sensor):
    """A sensor of one joint. What it sends is rare here, so it isn't stale for long."""

    Config = EndConfig
    config: EndConfig
    max_age = 5.0

    def __init__(self, name: str, config: EndConfig) -> None:
        super().__init__(name, config)
        self.states = (Signal(name="position", shape=(1,), unit="rad"),)
        self._rest = b""

    def open(self) -> None:
        """It is open."""
        self.health.opened()

    def read(self, now: int) -> None:
        """Takes the newest frame."""
        with contextlib.suppress(BlockingIOError):
            self._rest += os.read(int(self.config.port), 4096)
        found, self._rest = values(self._rest)
        if found and math.isfinite(found[-1]):
            self.state_arrays["position"][0] = found[-1]
            self.health.stamp = now
            self.health.frames += len(found)

    def close(self) -> None:
        """The socket is somebody else's."""


class Arm(Driver):
    """An actuator of one joint."""

    Config = EndConfig
    config: EndConfig

    def __init__(self, name: str, config: EndConfig) -> None:
        super().__init__(name, config)
        self.commands = (
            Command(name="command", shape=(1,), unit="rad", kind=Kind.POSITION, stops=(Stop.HOLD,), period=0.02),
        )
        self.home = {"command": np.zeros(1)}

    def open(self) -> None:
        """It is open."""
        self.health.opened()

    def read(self, now: int) -> None:
        """There is nothing to read."""
        self.health.stamp = now

    def write(self, now: int) -> None:
        """Sends the command."""
        value = self.command_arrays["command"].item()
        with contextlib.suppress(BlockingIOError):
            os.write(int(self.config.port), frame(value))
            self.sent_arrays["command"][0] = value

    def stop(self, category: Stop) -> None:
        """It holds what it has."""

    def close(self) -> None:
        """The socket is somebody else's."""
