"""What inertial sensors on a serial line share: they are listened to, and what they said last stands for a while."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Final, Generic, Protocol, TypeVar

import numpy as np
from pydantic import Field

from srl.drivers.linked import Linked
from srl.drivers.transport import Transport
from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.signals import Array

SILENT: Final = 5_000_000_000  # ns without a good frame after which the port is opened anew
FROZEN: Final = 500_000_000  # ns of the very same values: a sensor that lies still flickers in its last bits

FrameT = TypeVar("FrameT")


class FrameParser(Protocol[FrameT]):
    """Finds frames in a stream of bytes.

    Attributes:
        errors: what looked like a frame, and was none.
        resyncs: how often the next frame didn't follow the last one at once.
    """

    errors: int
    resyncs: int

    def feed(self, data: bytes) -> list[FrameT]:
        """Returns the frames that `data` completes, in order."""


class SerialImuConfig(DeviceConfig):
    """Options of every such sensor."""

    port: str = Field(description="link: a serial port's path, tcp://HOST:PORT, spy:FILE:URL")
    frame: str = Field("imu", description="frame of the profile's tree in which it is mounted: the sensor's own axes")
    hold: float = Field(0.05, gt=0, le=10, description="s, for which the last sample stands for later ones")


class SerialImu(Linked[Transport], Sensor, Generic[FrameT]):
    """A subclass takes the frames.

    Its states are NaN before the first sample and when the newest is older than `hold`. One whose values stand still to
    the last bit is no sample: the sensor hangs, though its counter goes on.

    Attributes:
        frames: the word of its protocol for them.
        remedy: what to do about a sensor that has fallen silent.
    """

    frames: ClassVar[str] = "frames"
    remedy: ClassVar[str]
    _parser: FrameParser[FrameT]

    def __init__(self, name: str, config: SerialImuConfig) -> None:
        super().__init__(name, config)
        self._hold = round(config.hold * 1e9)

    def _begin(self) -> None:
        """Forgets what was heard. A subclass adds its parser and its clock, and calls it when it is made or opened."""
        self._heard = -1  # ns, when the last frame came
        self._values: tuple[object, ...] = ()
        self._fresh = -1  # ns, of the sample whose values were last other ones

    @abstractmethod
    def _take(self, frame: FrameT, now: int) -> None:
        """Takes a frame that came by `now` (ns): its values, its time, what it says of lost ones."""

    def _receive(self, link: Transport, now: int) -> None:
        found = self._frames(link)
        if self._heard < 0 or found:
            self._heard = now
        for frame in found:
            self._take(frame, now)
        if self.health.stamp < 0 or now - self.health.stamp > self._hold:
            expire(self.state_arrays)
        if now - self._heard > SILENT:
            raise self._lost(f"no {self.frames} for {SILENT / 1e9:g} s", self.remedy)

    def _frozen(self, values: tuple[object, ...], stamp: int) -> bool:
        """Whether all that the sensor measures has stood still for too long, with this sample of `stamp` (ns)."""
        if values != self._values or self._fresh < 0:
            self._values, self._fresh = values, stamp
        if stamp - self._fresh <= FROZEN:
            return False
        self.health.message = "its values stand still to the last bit: switch it off and on"
        return True

    def _frames(self, link: Transport) -> list[FrameT]:
        parser, health = self._parser, self.health
        errors, resyncs = parser.errors, parser.resyncs
        data = link.read()
        found = parser.feed(data) if data else []
        health.errors += parser.errors - errors
        health.resyncs += parser.resyncs - resyncs
        return found


def expire(states: Mapping[str, Array]) -> None:
    """What isn't measured is no orientation."""
    for state in states.values():
        state.fill(np.nan)
