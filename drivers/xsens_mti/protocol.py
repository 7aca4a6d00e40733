"""Xbus messages of an Xsens MTi: the frame, what the host asks, and what it answers. No I/O.

Of the protocol sheet `imu_serial`, section 3.1, which was held against recordings of an MTi-G-710: the sum of all bytes
from the bus id to the checksum is 0 modulo 256.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple

PREAMBLE: Final = 0xFA
DEVICE: Final = 0xFF  # the bus id of a sensor by itself
EXTENDED: Final = 0xFF  # this length says that two bytes with the length follow
LONGEST: Final = 2048  # bytes of data; what claims more is noise
EVERY: Final = 0xFFFF  # rate of a configuration: with each message


class Id(IntEnum):
    """Message ids; an answer has the id of its question plus one."""

    REQ_DEVICE = 0x00
    DEVICE = 0x01
    GO_TO_MEASUREMENT = 0x10
    MEASURING = 0x11
    GO_TO_CONFIG = 0x30
    CONFIGURING = 0x31
    DATA = 0x36
    WAKEUP = 0x3E
    ERROR = 0x42
    CONFIGURATION = 0xC0
    CONFIGURED = 0xC1


ERRORS: Final = {3: "the period isn't supported", 4: "the message is invalid", 30: "the baud rate is too low for it"}
_PAIRS: Final = Struct(">HH")


class Message(NamedTuple):
    """One message.

    Attributes:
        id: of the message.
        data: its bytes.
    """

    id: int
    data: bytes


def encode(message: Message) -> bytes:
    """The bytes of a message. Raises ValueError: longer than the device takes."""
    size = len(message.data)
    if size > LONGEST:
        raise ValueError(f"{size} bytes of data; {LONGEST} at most")
    length = bytes((size,)) if size < EXTENDED else bytes((EXTENDED,)) + size.to_bytes(2, "big")
    body = bytes((DEVICE, message.id)) + length + message.data
    return bytes((PREAMBLE,)) + body + bytes((-sum(body) % 256,))


def configuration(data: bytes) -> dict[int, int] | None:
    """The output configuration of an answer: id of each item, its rate (Hz). None: the bytes aren't one."""
    if len(data) % _PAIRS.size:
        return None
    return dict(_PAIRS.iter_unpack(data))


def configure(items: dict[int, int]) -> bytes:
    """The message that sets the output configuration, of at most 32 items."""
    return encode(Message(Id.CONFIGURATION, b"".join(_PAIRS.pack(*item) for item in items.items())))


class Parser:
    """Finds the messages in a stream of bytes; the result doesn't depend on how the stream was split.

    Data may look like a preamble. So what follows counts only if the checksum fits; else the search goes on at the next
    byte.

    Attributes:
        frames: good messages. errors: preambles without one. resyncs: how often the next message didn't follow the
            last one at once.
    """

    def __init__(self) -> None:
        self.frames = self.errors = self.resyncs = 0
        self._buffer = bytearray()
        self._lost = False

    def feed(self, data: bytes) -> list[Message]:
        """Returns the messages that `data` completes, in order."""
        buffer = self._buffer
        buffer += data
        found: list[Message] = []
        at = 0
        while at < len(buffer):
            if buffer[at] != PREAMBLE:
                self.resyncs += not self._lost
                self._lost = True
                following = buffer.find(PREAMBLE, at)
                at = following if following >= 0 else len(buffer)
                continue
            begin, size = _head(buffer, at)
            if size is None:
                break
            end = begin + size + 1
            if size <= LONGEST and end > len(buffer):
                break
            if size > LONGEST or sum(buffer[at + 1 : end]) % 256:
                self.errors += 1
                self.resyncs += not self._lost
                self._lost = True
                at += 1
                continue
            self._lost = False
            self.frames += 1
            found.append(Message(buffer[at + 2], bytes(buffer[begin : end - 1])))
            at = end
        del buffer[:at]
        return found


def _head(buffer: bytearray, at: int) -> tuple[int, int | None]:
    """Where the data begin, and their length; None: its bytes haven't come yet."""
    left = len(buffer) - at
    if left < 4 or (buffer[at + 3] == EXTENDED and left < 6):
        return at, None
    if buffer[at + 3] == EXTENDED:
        return at + 6, int.from_bytes(buffer[at + 4 : at + 6], "big")
    return at + 4, buffer[at + 3]
