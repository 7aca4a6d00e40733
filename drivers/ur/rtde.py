"""RTDE's framing, both directions, without any I/O. Source: protocol sheet ur-rtde, section 2.

A message is `u16 size` (of the whole message), `u8 kind`, payload; everything is big-endian. There is no checksum.
So in a stream of garbage the parser looks for a header that fits its kind and, for data, for a recipe of ours.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Final, NamedTuple

HEADER: Final = struct.Struct(">HB")
PROTOCOL: Final = 2
NAMES: Final = 2048  # greatest number of bytes of names that a controller accepts
_TYPES: Final = 4096  # bytes of types in an answer: the longest type name is longer than the shortest variable name
_TEXT: Final = 3 + 1 + 255 + 1 + 255 + 1


class Kind(IntEnum):
    """A message's type byte."""

    PROTOCOL = ord("V")
    CONTROLLER = ord("v")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")
    DATA = ord("U")
    TEXT = ord("M")


_DATA: Final = int(Kind.DATA)

# Smallest and largest size of a whole message, header included.
ANSWERS: Final[dict[int, tuple[int, int]]] = {
    Kind.PROTOCOL: (4, 4),
    Kind.CONTROLLER: (19, 19),
    Kind.OUTPUTS: (4, _TYPES),
    Kind.INPUTS: (4, _TYPES),
    Kind.START: (4, 4),
    Kind.PAUSE: (4, 4),
    Kind.TEXT: (6, _TEXT),
}
REQUESTS: Final[dict[int, tuple[int, int]]] = {
    Kind.PROTOCOL: (5, 5),
    Kind.CONTROLLER: (3, 3),
    Kind.OUTPUTS: (3, 3 + 8 + NAMES),
    Kind.INPUTS: (3, 3 + NAMES),
    Kind.START: (3, 3),
    Kind.PAUSE: (3, 3),
    Kind.TEXT: (3, _TEXT),
}
STREAM: Final[dict[int, tuple[int, int]]] = {
    Kind.TEXT: (6, _TEXT),
    Kind.PAUSE: (4, 4),
}  # all kinds that may come besides data once it was started


class Message(NamedTuple):
    """One message; `body` is the part after the header."""

    kind: int
    body: bytes


class Text(NamedTuple):
    """A text message of the controller; level 0 exception, 1 error, 2 warning, 3 information."""

    text: str
    source: str
    level: int


class Parser:
    """Turns bytes into messages. Never raises, and keeps at most one incomplete message.

    Attributes:
        sizes: by kind, the smallest and the largest size of a message; others are garbage.
        data: by recipe, the size of a data message; others are garbage.
        frames: messages found.
        errors: messages whose content doesn't fit their header.
        resyncs: number of times the parser had to search for the next message.
        skipped: bytes skipped in these searches.
    """

    def __init__(self, sizes: dict[int, tuple[int, int]]) -> None:
        self.sizes = dict(sizes)
        self.data: dict[int, int] = {}
        self.frames = self.errors = self.resyncs = self.skipped = 0
        self._rest = b""
        self._lost = False

    def only(self, sizes: dict[int, tuple[int, int]]) -> None:
        """From now on accepts only these kinds, and data, as messages."""
        self.sizes = dict(sizes)

    def sole(self, chunk: bytes) -> bytes | None:
        """The body, where these bytes are one data message and nothing else, as the packet of one cycle is.

        Returns:
            None if they are anything else: then `feed` is to take them.
        """
        size = len(chunk)
        if self._rest or size < 4 or chunk[2] != _DATA:
            return None
        if not chunk[0] << 8 | chunk[1] == size == self.data.get(chunk[3]):
            return None
        self.frames += 1
        self._lost = False
        return chunk[3:]

    def feed(self, chunk: bytes) -> list[Message]:
        """Takes bytes as they come; returns the messages they complete, oldest first."""
        buffer = self._rest + chunk if self._rest else chunk
        found: list[Message] = []
        at, end = 0, len(buffer)
        while end - at >= 3:
            size, kind = HEADER.unpack_from(buffer, at)
            if not self._fits(size, kind, buffer, at, end):
                at = self._skip(at, buffer)
                continue
            if size > end - at:
                break
            body = buffer[at + 3 : at + size]
            if kind in _CHECKED and not _whole(kind, body):
                self.errors += 1
                at = self._skip(at, buffer)
                continue
            found.append(Message(kind, body))
            self.frames += 1
            self._lost = False
            at += size
        self._rest = buffer[at:]
        return found

    def _fits(self, size: int, kind: int, buffer: bytes, at: int, end: int) -> bool:
        if kind == Kind.DATA:
            if end - at > 3:
                return self.data.get(buffer[at + 3]) == size
            return size in self.data.values()
        bounds = self.sizes.get(kind)
        return bounds is not None and bounds[0] <= size <= bounds[1]

    def _skip(self, at: int, buffer: bytes) -> int:
        """Returns where the next header may begin.

        A search byte by byte would delay the loop in a flood of garbage.
        """
        if not self._lost:
            self._lost = True
            self.resyncs += 1
        found = _HEADER.search(buffer, at + 1)
        to = found.start() if found is not None else max(at + 1, len(buffer) - 2)
        self.skipped += to - at
        return to


_HEADER: Final = re.compile(rb"[\x00-\x1f].[" + bytes(Kind) + rb"]", re.DOTALL)  # no message has 8 KB
_CHECKED: Final = frozenset((Kind.OUTPUTS, Kind.INPUTS, Kind.TEXT))


def _whole(kind: int, body: bytes) -> bool:
    """Returns whether the content of a text-type message fits: names or types after at most 8 bytes, or a text."""
    if kind != Kind.TEXT:
        names = body[8:] if len(body) > 8 else b""
        return all(32 <= byte < 127 for byte in names)
    return text(body) is not None


def text(body: bytes) -> Text | None:
    """Returns the parts of a text message (version 2); None if the lengths inside don't fit."""
    if not body or len(body) < 3 + body[0]:
        return None
    end = 1 + body[0]
    source_end = end + 1 + body[end]
    if len(body) != source_end + 1:
        return None
    decode = "latin-1"
    return Text(body[1:end].decode(decode), body[end + 1 : source_end].decode(decode), body[-1])


# -- encoders for both sides


def message(kind: Kind, payload: bytes = b"") -> bytes:
    """Encodes any message."""
    return HEADER.pack(3 + len(payload), kind) + payload


def ask_protocol(version: int = PROTOCOL) -> bytes:
    """`V`: requests a version of the protocol."""
    return message(Kind.PROTOCOL, struct.pack(">H", version))


def ask_controller() -> bytes:
    """`v`: requests the controller's version."""
    return message(Kind.CONTROLLER)


def ask_outputs(rate: float, names: Sequence[str]) -> bytes:
    """`O`: requests these variables at `rate` Hz."""
    return message(Kind.OUTPUTS, struct.pack(">d", rate) + ",".join(names).encode("ascii"))


def ask_inputs(names: Sequence[str]) -> bytes:
    """`I`: claims these variables as inputs."""
    return message(Kind.INPUTS, ",".join(names).encode("ascii"))


def start() -> bytes:
    """`S`: starts the data."""
    return message(Kind.START)


def pause() -> bytes:
    """`P`: pauses the data."""
    return message(Kind.PAUSE)


def remark(words: str, source: str, level: int) -> bytes:
    """`M`: a text message of version 2."""
    parts = [part.encode("latin-1", "replace")[:255] for part in (words, source)]
    return message(Kind.TEXT, b"".join(bytes((len(part),)) + part for part in parts) + bytes((level,)))


def accepted(kind: Kind, yes: bool = True) -> bytes:
    """The controller's answer to `V`, `S`, `P`."""
    return message(kind, bytes((yes,)))


def version(numbers: Sequence[int]) -> bytes:
    """The controller's answer to `v`: major, minor, bug fix, build."""
    return message(Kind.CONTROLLER, struct.pack(">4I", *numbers))


def recipe(kind: Kind, number: int, types: Sequence[str]) -> bytes:
    """The controller's answer to `O` and `I`."""
    return message(kind, bytes((number,)) + ",".join(types).encode("ascii"))
