"""The twin of a BNO085: frames on a serial port, without being asked."""

from __future__ import annotations

from typing import Final

from srl.drivers.bno085.protocol import encode
from srl.sim.devices.bno085.fake import FakeBno085, record
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.shared.stream_twin import Due

BANNER: Final = b"%Hillcrest Labs 10003608\n\r%SW Ver 3.2.7\n\r%(c) 2017 Hillcrest Laboratories, Inc.\n\r"
_CATCH_UP: Final = 20  # most frames sent at once; older ones were never taken in time


class Bno085Twin(SerialTwin):
    """Sends the fake's samples as frames; one that the fake loses is a gap in the index.

    After `restart` the index begins at 0 again, behind the text that the sensor sends when it starts.
    """

    def __init__(self, fake: FakeBno085) -> None:
        super().__init__(fake)
        self.imu = fake
        self._due = Due(fake, _CATCH_UP)
        self._first = 0  # number of the sample with index 0
        self._starting = False

    def open(self) -> None:
        super().open()
        self._due.begin()

    def restart(self) -> None:
        """The sensor is switched off and on."""
        self._first, self._starting = self.imu.newest() + 1, True

    def receive(self, data: bytes, now: int) -> bytes:
        """In this mode the sensor listens to nothing."""
        return b""

    def work(self, now: int) -> bytes:
        frames = [BANNER] if self._starting else []
        self._starting = False
        frames += [encode(record(values, number - self._first)) for number, values in self._due.take()]
        return b"".join(frames)
