"""The twin of a board that sends numbers over a serial line: it restarts when its port is opened, then sends."""

from __future__ import annotations

from srl.drivers.serial_lines.protocol import encode
from srl.runtime.contracts.signals import Array
from srl.sim.devices.serial_lines.fake import FakeSerialLines
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.shared.stream_twin import Due

BOOT = 300_000_000  # ns that it needs until it sends
_MOST = 20  # samples sent at once, after the twin was busy


class SerialLinesTwin(SerialTwin):
    """Each sample is sent when it is due; those before a client came are gone.

    Attributes:
        garbled: number of following samples of which a byte is flipped on the way.
    """

    def __init__(self, fake: FakeSerialLines) -> None:
        super().__init__(fake)
        self.board = fake
        self.garbled = 0
        self._due = Due(fake, _MOST)
        self._ready, self._counter = -1, 0

    def connected(self, now: int) -> None:
        self._ready, self._counter = now + BOOT, 0

    def receive(self, data: bytes, now: int) -> bytes:
        return b""

    def work(self, now: int) -> bytes:
        if now < self._ready or self._ready < 0:
            self._due.begin()
            return b""
        return b"".join(self._frame(values) for _, values in self._due.take())

    def _frame(self, values: Array) -> bytes:
        config, numbers = self.board.lines, self.board.numbers
        columns = [0.0] * config.columns
        for place, number in zip(numbers.places, numbers.numbers(values), strict=True):
            columns[place - 1] = number
        if config.counter is not None:
            columns[config.counter - 1] = self._counter % config.counter_modulus
        self._counter += 1
        frame = encode(config, columns)
        if self.garbled:
            self.garbled -= 1
            middle = len(frame) // 2
            frame = frame[:middle] + bytes((frame[middle] ^ 0x80,)) + frame[middle + 1 :]
        return frame
