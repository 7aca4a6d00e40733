"""One client of the simulated DataStream server: its subscription, its mode, and what was sent to it."""

from __future__ import annotations

import struct

from srl.drivers.vicon import blocks, protocol
from srl.drivers.vicon.blocks import MalformedError
from srl.drivers.vicon.protocol import Block, Packet
from srl.sim.devices.shared.sockets import Client
from srl.sim.devices.vicon.twin_frame import OFFERED, FrameMaker


class Session:
    """One client's session; the server sends first. A client that sends an invalid packet is disconnected (A.6).

    Attributes:
        sent: numbers of the samples sent; the caller empties the list.
    """

    def __init__(self, client: Client, maker: FrameMaker) -> None:
        self.client = client
        self.sent: list[int] = []
        self._maker, self._fake = maker, maker.fake
        self._parser = protocol.Parser()
        self._wanted: frozenset[int] = frozenset()
        self._allowed: dict[int, set[int]] = {}
        self._known: set[int] = set()
        self._streaming = False
        self._now = False  # whether the newest frame is requested
        self._owed = 0  # number of next frames requested
        self._last = self._fake.newest()  # newest sample that was sent or skipped
        client.write(protocol.object_enums(OFFERED), keep=True)

    def forget(self) -> None:
        """Sends static blocks again, after they have changed."""
        self._known.clear()

    def service(self) -> None:
        """Obeys requests and sends what is due."""
        for packet in self._parser.feed(self.client.read()):
            try:
                self._obey(packet)
            except MalformedError:
                self.client.close()
        if self._parser.errors:
            self.client.close()
        newest = self._fake.newest()
        self._last = min(self._last, newest)  # the world was restored to an earlier state
        oldest = newest - self._fake.kept + 1
        if self._streaming:
            self._send(range(max(self._last + 1, oldest), newest + 1))
        elif self._owed:
            self._send(range(max(self._last + 1, newest - self._owed + 1, oldest), newest + 1))
        elif self._now:
            found = (n for n in range(newest, max(oldest - 1, -1), -1) if self._fake.sample(n) is not None)
            number = next(found, None)
            if number is not None:
                self._now = False
                self._send(range(number, number + 1))
        self._last = newest

    def _obey(self, packet: Packet) -> None:
        for kind, body in packet:
            if kind == Block.OBJECT_ENUMS:
                self._wanted = blocks.enums(body) & OFFERED
                self._known &= self._wanted
            elif kind == Block.REQUEST_FRAME:
                if not len(body):
                    raise MalformedError("a request without its flag")
                self._streaming = body[0] != 0
                self._now, self._owed = not self._streaming, 0
            elif kind == Block.REQUEST_NEXT_FRAME:
                self._owed += blocks.whole(body)
            elif kind == Block.FILTER:
                self._allowed = _filter(body)
            elif kind == Block.PING:
                self.client.write(protocol.packet(protocol.block(kind, bytes(body))), keep=True)

    def _send(self, numbers: range) -> None:
        for number in numbers:
            values = self._fake.sample(number)
            if values is None:
                continue
            known = set(self._known)
            lost = self.client.lost
            self.client.write(self._maker.packet(number, values, self._wanted, known, self._allowed))
            if self.client.lost == lost:
                self._known = known
                self.sent.append(number)
            self._owed = max(self._owed - 1, 0)


def _filter(body: memoryview) -> dict[int, set[int]]:
    """Decodes Filter: allowed numbers by block type."""
    try:
        (count,), at = struct.unpack_from("<I", body), 4
        found: dict[int, set[int]] = {}
        for _ in range(count):
            kind, size = struct.unpack_from("<II", body, at)
            if 4 * size > len(body):
                raise MalformedError("a filter shorter than its lists")
            found[kind] = set(struct.unpack_from(f"<{size}I", body, at + 8))
            at += 8 + 4 * size
    except struct.error:
        raise MalformedError("a filter shorter than its lists") from None
    return found
