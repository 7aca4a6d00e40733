"""The twin of a CyberGlove: a simulated glove with the real one's serial protocol."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.sim.devices.cyberglove.fake import FakeCyberGlove
from srl.sim.devices.cyberglove.twin_commands import Commands
from srl.sim.devices.shared.dialing import DialingDoor
from srl.sim.devices.shared.serial import SerialTwin

_CATCH_UP = 50  # most records sent at once; older samples were never taken in time


class CyberGloveTwin(SerialTwin):
    """Answers all commands of the sheet's table and streams the fake's samples at the fake's sampling times.

    Record k is sent when sample k would reach a client of the fake. So the fake and the twin give the same values
    at the same world time. A sample that the fake drops is never sent.

    Attributes:
        unplugged: the glove is disconnected from its interface, which still answers and reports it (`eg`, status
            bit 0).
    """

    def __init__(self, fake: FakeCyberGlove) -> None:
        super().__init__(fake)
        self.glove = fake
        if fake.config.port.startswith("tcp-listen://"):  # type: ignore[attr-defined]
            self.door = DialingDoor(fake.config.port)  # type: ignore[attr-defined]
        self.unplugged = False
        self._flipped = False  # whether `W` has inverted the switch
        self._bytes = b""
        self._sent = -1  # number of the newest streamed sample
        self._streamed: list[tuple[int, int]] = []
        self.commands = Commands(self)

    def open(self) -> None:
        super().open()
        self.commands.restart()
        self._sent = self.glove.newest()

    def connected(self, now: int) -> None:
        """Over Wi-Fi, the glove announces itself first (sheet, 1)."""
        if isinstance(self.door, DialingDoor):
            self.door.write(b"o")

    def receive(self, data: bytes, now: int) -> bytes:
        was = self.commands.streaming
        answer = self.commands.feed(data)
        if self.commands.streaming and not was:
            self._sent = self.glove.newest()
        return answer

    def work(self, now: int) -> bytes:
        newest = self.glove.newest()
        if newest <= self._sent:
            return b""
        first = max(self._sent + 1, newest - _CATCH_UP + 1)
        self._sent = newest
        if not self.commands.streaming:
            return b""
        records = []
        for number in range(first, newest + 1):
            angles = self.glove.sample(number)
            if angles is not None:
                self._bytes = self.glove.raw(angles).tobytes()
                records.append(self.commands.record(b"S", self._bytes))
                if self.keep_log:
                    self._streamed.append((now, self.glove.taken_at(number)))
        return b"".join(records)

    def metrics(self) -> dict[str, object]:
        """Adds to the serial twin's figures: commands by letter, unknown bytes."""
        return super().metrics() | {"commands": dict(self.commands.seen), "unknown": self.commands.unknown}

    def log(self) -> dict[str, NDArray[Any]]:
        """Adds to the serial twin's log: `sent_ns` (k,), when each record was sent; `taken_ns` (k,), its world time."""
        sent, taken = np.array(self._streamed, np.int64).reshape(-1, 2).T
        return super().log() | {"sent_ns": sent, "taken_ns": taken}

    # -- what the command interpreter uses

    @property
    def count(self) -> int:
        """Number of sensors."""
        return int(self.glove.states[0].size)

    @property
    def right(self) -> bool:
        """Whether it is a right-hand glove."""
        return bool(self.glove.config.hand == "right")  # type: ignore[attr-defined]

    @property
    def period(self) -> Fraction:
        """Time between samples, ns."""
        return self.glove.period

    @period.setter
    def period(self, period: Fraction) -> None:
        self.glove.set_period(period)
        self._sent = self.glove.newest()

    def newest(self) -> bytes:
        """The newest sample that wasn't lost, one byte for each sensor."""
        angles = self.glove.sample(max(self.glove.newest(), 0))
        if angles is not None:
            self._bytes = self.glove.raw(angles).tobytes()
        return self._bytes or b"\x01" * self.count

    def plugged(self) -> bool:
        """Whether the glove is connected to its interface."""
        return not self.unplugged

    def switch(self) -> bool:
        """Whether the wrist switch is on."""
        return self.glove.switch(self.glove.world.time) != self._flipped

    def set_switch(self, on: bool) -> None:
        """Command `W`: the switch's present state counts as `on`."""
        self._flipped = self.glove.switch(self.glove.world.time) != on

    def milliseconds(self) -> int:
        """The glove's own clock, ms: the time of the newest sample."""
        return self.glove.taken_at(max(self.glove.newest(), 0)) // 1_000_000
