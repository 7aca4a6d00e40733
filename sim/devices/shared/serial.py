"""What the twins of serial devices share: the door, the loss of the cable, the log of bytes."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.world import Fake, Twin
from srl.sim.devices.shared.dialing import DialingDoor
from srl.sim.devices.shared.pty import PtyDoor
from srl.sim.devices.shared.windows import Plug


class SerialTwin(Twin):
    """A twin behind a pty.

    During the `loss` windows of the fake's options the port is removed, as with an unplugged cable. `muted` leaves
    it open and discards what is sent, like a device whose program hangs.

    Attributes:
        link: a symlink that follows the port's changing path; set it before `open`.
        muted: the device neither obeys nor answers.
        keep_log: whether to store every byte received and its time, for `log`.
    """

    def __init__(self, fake: Fake) -> None:
        super().__init__(fake)
        self.door: PtyDoor | DialingDoor = PtyDoor()
        self.muted = False
        self.keep_log = False
        self._chunks: list[tuple[int, bytes]] = []
        self._plug = Plug(fake)
        self._last_in: int | None = None

    @property
    def link(self) -> Path | None:
        """See the class."""
        return self.door.link

    @link.setter
    def link(self, path: Path | None) -> None:
        self.door.link = path

    def open(self) -> None:
        self.door.open()
        self.address = self.door.address

    def close(self) -> None:
        """A client that has the port open sees it hang up. `open` creates the port again."""
        self.door.close()
        self.address = ""

    def service(self, now: int) -> None:
        self._plug.follow(self.close, self.open)
        if not self.door.is_open:
            self.work(now)
            return
        connects = self.door.connects
        data = self.door.read()  # first: a client that has sent something is there, even if it has just connected
        there = self.door.connected()
        if self.door.connects > connects and not self.muted:
            self.connected(now)
        if data:
            self._last_in = now
            if self.keep_log:
                self._chunks.append((now, data))
        if self.muted:
            return
        self.door.write(self.receive(data, now) if data else b"")
        answer = self.work(now)
        self.door.write(answer if there else b"")

    def connected(self, now: int) -> None:
        """Called when a client has opened the port."""

    @abstractmethod
    def receive(self, data: bytes, now: int) -> bytes:
        """Carries out the client's bytes and returns the device's answer."""

    @abstractmethod
    def work(self, now: int) -> bytes:
        """Does what the device does by itself at `now`, with or without a client; returns what it sends."""

    def metrics(self) -> dict[str, object]:
        """Connections, bytes in each direction and lost, time of the last bytes received (ns)."""
        return {
            "connects": self.door.connects,
            "bytes_in": self.door.bytes_in,
            "bytes_out": self.door.bytes_out,
            "bytes_lost": self.door.lost,
            "last_in_ns": self._last_in,
        }

    def log(self) -> dict[str, NDArray[Any]]:
        """`rx` (k,): the bytes received. `rx_ns` (k,): when each was received (ns of the twin's clock)."""
        times = [at for at, data in self._chunks for _ in data]
        return {
            "rx": np.frombuffer(b"".join(data for _, data in self._chunks), np.uint8),
            "rx_ns": np.array(times, np.int64),
        }
