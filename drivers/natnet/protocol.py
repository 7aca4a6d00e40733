"""NatNet's packets: header, handshake, requests (sheet optitrack_natnet, 1, 2, 4, 8). Little-endian. No I/O.

Every function that takes bytes takes any; what is too short or holds no such packet raises `MalformedError`.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from math import isfinite
from typing import Final, NamedTuple

COMMAND_PORT: Final = 1510
DATA_PORT: Final = 1511
HEADER: Final = struct.Struct("<HH")
_NAME: Final = 256  # bytes
_SERVER: Final = struct.Struct("<256s4B4BQHB4B")
_CLIENT: Final = struct.Struct("<256s4B4B")
_WANTS: Final = struct.Struct("<B4B")
_OURS: Final = (4, 1, 0, 0)  # the NatNet version that a client names; what comes is the server's own
_TICKS: Final = (1_000, 10**11)  # Hz, of a clock that can be one


class Message(IntEnum):
    """Message ids."""

    CONNECT = 0
    SERVER_INFO = 1
    REQUEST = 2
    RESPONSE = 3
    REQUEST_MODEL = 4
    MODEL = 5
    REQUEST_FRAME = 6
    FRAME = 7
    TEXT = 8
    DISCONNECT = 9
    KEEP_ALIVE = 10
    TIMEOUT = 11
    ECHO = 12
    ECHOED = 13
    DISCOVERY = 14
    UNRECOGNISED = 100


class MalformedError(ValueError):
    """These bytes aren't such a packet."""


class Version(NamedTuple):
    """Of the stream: it decides the layout of frames and descriptions."""

    major: int
    minor: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}"


class ServerInfo(NamedTuple):
    """What a server says of itself.

    Attributes:
        application: such as Motive.
        program: its version, four numbers.
        version: the stream's.
        frequency: Hz, ticks of the clock of all stamps.
        data_port: from where, or to which group's port, frames are sent.
        multicast: frames go to `group`.
    """

    application: str
    program: tuple[int, ...]
    version: Version
    frequency: int
    data_port: int
    multicast: bool
    group: str


class Cursor:
    """Reads fields one after another, and never beyond the end."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data, self.at = data, at

    @property
    def left(self) -> int:
        """Bytes that are left."""
        return len(self.data) - self.at

    def take(self, form: struct.Struct) -> tuple[float, ...]:
        """Reads a structure."""
        try:
            values = form.unpack_from(self.data, self.at)
        except struct.error:
            raise MalformedError(f"{len(self.data)} bytes are too few") from None
        self.at += form.size
        return values

    def whole(self) -> int:
        """Reads an i32."""
        return int(self.take(_I32)[0])

    def count(self, least: int) -> int:
        """Reads a number of items of `least` bytes or more. Raises MalformedError: they can't be there."""
        count = self.whole()
        if not 0 <= count * least <= self.left or (least == 0 and count > self.left):
            raise MalformedError(f"{count} items don't fit into {self.left} bytes")
        return count

    def skip(self, size: int) -> None:
        """Leaves bytes out."""
        if not 0 <= size <= self.left:
            raise MalformedError(f"{size} bytes of {self.left}")
        self.at += size

    def text(self) -> str:
        """Reads a string that a zero byte ends."""
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise MalformedError("a name without an end")
        raw, self.at = self.data[self.at : end], end + 1
        return raw.decode("utf-8", "replace")


_I32: Final = struct.Struct("<i")


def packet(message: int, payload: bytes = b"") -> bytes:
    """A datagram."""
    return HEADER.pack(message, len(payload)) + payload


def split(datagram: bytes) -> tuple[int, bytes]:
    """The message id and the payload. A cut datagram is malformed; bytes behind the payload are left out."""
    if len(datagram) < HEADER.size:
        raise MalformedError(f"{len(datagram)} bytes")
    message, size = HEADER.unpack_from(datagram)
    if len(datagram) - HEADER.size < size:
        raise MalformedError(f"{size} bytes of payload announced, {len(datagram) - HEADER.size} came")
    return message, datagram[HEADER.size : HEADER.size + size]


def connect(name: str = "srl") -> bytes:
    """The packet that asks for the server info, all data, in the server's own version."""
    return packet(Message.CONNECT, _client(name) + _WANTS.pack(0, 0, 0, 0, 0))


def keep_alive(name: str = "srl") -> bytes:
    """The packet that a unicast client sends once a second."""
    return packet(Message.KEEP_ALIVE, _client(name))


def request(text: str) -> bytes:
    """A request in words."""
    return packet(Message.REQUEST, text.encode() + b"\0")


REQUEST_MODEL: Final = packet(Message.REQUEST_MODEL, b"\xff\xff\xff\xff")


def server_info(payload: bytes) -> ServerInfo:
    """Decodes a server info of NatNet 3 or 4. Raises MalformedError: another version's, or slipped bytes."""
    if len(payload) < _SERVER.size:
        raise MalformedError(f"a server info of {len(payload)} bytes; since NatNet 3.0 it has {_SERVER.size}")
    raw, *values = _SERVER.unpack_from(payload)
    program, version = tuple(values[:4]), Version(values[4], values[5])
    frequency, port, multicast = values[8:11]
    if version.major not in (3, 4):
        raise MalformedError(f"NatNet {version}; this driver reads 3.x and 4.x")
    if not _TICKS[0] <= frequency <= _TICKS[1] or not port:
        raise MalformedError(f"a clock of {frequency} Hz and port {port}")
    name = raw.split(b"\0")[0].decode("utf-8", "replace")  # what follows the zero is garbage
    return ServerInfo(name, program, version, frequency, port, multicast == 1, ".".join(map(str, values[11:15])))


def encode_server_info(info: ServerInfo) -> bytes:
    """The packet of a server info."""
    group = [int(part) for part in info.group.split(".")]
    name = info.application.encode()[: _NAME - 1]
    return packet(
        Message.SERVER_INFO,
        _SERVER.pack(
            name, *info.program, *info.version, 0, 0, info.frequency, info.data_port, int(info.multicast), *group
        ),
    )


def value(payload: bytes) -> float | None:
    """The f32 of a response; None if it holds something else, such as text."""
    if len(payload) != 4:
        return None
    (found,) = struct.unpack("<f", payload)
    return float(found) if isfinite(found) else None


def _client(name: str) -> bytes:
    return _CLIENT.pack(name.encode()[: _NAME - 1], 1, 0, 0, 0, *_OURS)
