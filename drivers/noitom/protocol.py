"""Axis Neuron's BVH broadcast, binary with the old header and text (sheet, 3 and 4). No I/O.

A parser decodes the newest frame of the data and only counts the older ones, because an old pose is of no use.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from srl.drivers.noitom.skeleton import JOINTS

HEADER: Final = struct.Struct("<HIHBBI32sI12xH")  # 64 bytes
TOKENS: Final = (0xDDFF, 0xEEFF)
COUNTS: Final = {354: (True, False), 180: (False, False), 360: (True, True), 186: (False, True)}
END: Final = b"||"
LONGEST: Final = 32768  # bytes of a text record: 360 numbers of up to 20 characters and some extra
_EXPONENT: Final = np.uint32(0x7F800000)
_START: Final = b"\xff\xdd"


@dataclass(slots=True)
class Frame:
    """One avatar's pose.

    Attributes:
        values: as received: cm and degrees, the reference block first if there is one.
        displacement, reference: whether `values` has these besides rotations.
        avatar: index.
        name: the avatar's name.
        number: the avatar's frame number; -1 in text, which has none.
    """

    values: NDArray[np.float64]
    displacement: bool
    reference: bool
    avatar: int
    name: str
    number: int

    def split(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns (k, 3) translations, cm: k is 59, or 1 without displacement; (59, 3) rotations, degrees in order."""
        values = self.values[6:] if self.reference else self.values
        if self.displacement:
            rows = values.reshape(JOINTS, 6)
            return rows[:, :3], rows[:, 3:]
        return values[:3].reshape(1, 3), values[3:].reshape(JOINTS, 3)


class Parser(Protocol):
    """The interface of both parsers.

    Attributes:
        frames: frames of the wanted avatar.
        errors: frames discarded as invalid.
        resyncs: number of times sync was lost.
        others: frames of other avatars.
    """

    frames: int
    errors: int
    resyncs: int
    others: int

    def feed(self, data: bytes) -> Frame | None:
        """Returns the newest frame that `data` completes."""
        ...


class BinaryParser:
    """Parses the binary form; see `Parser`. `avatar`: the wanted one."""

    def __init__(self, avatar: int = 0) -> None:
        self.frames = self.errors = self.resyncs = self.others = 0
        self._avatar = avatar
        self._rest = b""

    def feed(self, data: bytes) -> Frame | None:
        data = self._rest + data
        at, newest = 0, -1
        lost = False
        while len(data) - at >= HEADER.size:
            size = _frame_size(data, at)
            if size == 0:
                self.resyncs += not lost
                lost = True
                found = data.find(_START, at + 1)
                at = found if found >= 0 else len(data) - (data[-1:] == _START[:1])
                continue
            if len(data) - at < size:
                break
            lost = False
            if struct.unpack_from("<I", data, at + 10)[0] == self._avatar:
                self.frames += 1
                newest = at
            else:
                self.others += 1
            at += size
        self._rest = data[at:]
        if newest < 0:
            return None
        frame = _decode(data, newest)
        if frame is None:
            self.frames -= 1
            self.errors += 1
        return frame


class TextParser:
    """Parses the text form; see `Parser`."""

    def __init__(self, avatar: int = 0) -> None:
        self.frames = self.errors = self.resyncs = self.others = 0
        self._avatar = b"%d" % avatar
        self._rest = b""

    def feed(self, data: bytes) -> Frame | None:
        *records, rest = (self._rest + data).split(END)
        if len(rest) > LONGEST:
            self.resyncs += 1
            rest = rest[-1:]
        self._rest = rest
        newest = None
        for record in reversed(records):
            number, _, values = record.lstrip().partition(b" ")
            if number != self._avatar:
                if number.isdigit():
                    self.others += 1
                else:
                    self.errors += 1
            elif newest is not None or (newest := _parse(values, int(number))) is not None:
                self.frames += 1
            else:
                self.errors += 1
        return newest


def _frame_size(data: bytes, at: int) -> int:
    """Returns the bytes of the frame whose header is at `at`; 0 if there is none."""
    token, _, count, _, _, _, _, _, end = HEADER.unpack_from(data, at)
    return HEADER.size + 4 * count if (token, end) == TOKENS and count in COUNTS else 0


def _decode(data: bytes, at: int) -> Frame | None:
    _, _, count, _, _, avatar, name, number, _ = HEADER.unpack_from(data, at)
    bits = np.frombuffer(data, "<u4", count, at + HEADER.size)
    if (bits & _EXPONENT == _EXPONENT).any():  # infinite or NaN; as numbers, some of these would cause warnings
        return None
    values = bits.view("<f4").astype(np.float64)
    # Some senders set wrong flags (§8); the count can't be wrong.
    displacement, reference = COUNTS[count]
    return Frame(values, displacement, reference, avatar, name.split(b"\0")[0].decode("ascii", "replace"), number)


def _parse(text: bytes, avatar: int) -> Frame | None:
    """Parses `<name> <v1> ... <vN> `, by a JSON parser, which reads numbers several times faster than `float`."""
    if b"," in text:
        return None
    name, _, numbers = text.partition(b" ")
    words = numbers.strip()
    try:
        found = from_json(b"[" + words.replace(b" ", b",") + b"]")
    except ValueError:
        found = words.split()  # tabs, +1, .5: valid numbers all the same
    if len(found) not in COUNTS:
        return None
    try:
        values = np.array(found, dtype=np.float64)
    except (ValueError, TypeError, OverflowError):
        return None
    if values.ndim != 1 or not np.isfinite(values).all():
        return None
    displacement, reference = COUNTS[len(found)]
    return Frame(values, displacement, reference, avatar, name.decode("ascii", "replace"), -1)


def encode_binary(values: NDArray[np.float64], number: int, avatar: int = 0, name: str = "Char00") -> bytes:
    """Encodes a frame of 354, 180, 360 or 186 values, cm and degrees, with the old header, version 1.1.0.0."""
    displacement, reference = COUNTS[values.size]
    header = HEADER.pack(
        TOKENS[0], 0x01010000, values.size, displacement, reference, avatar, name.encode(), number, TOKENS[1]
    )
    return header + values.astype("<f4").tobytes()


def encode_text(values: NDArray[np.float64], avatar: int = 0, name: str = "Char00") -> bytes:
    """Encodes a text record of the same values with four decimals."""
    return f"{avatar} {name} {' '.join(f'{value:.4f}' for value in values)} ||\r\n".encode()
