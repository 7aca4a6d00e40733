"""ROS 2's Common Data Representation (XCDR1, little endian) of the standard messages that bus and exports use.

A message is a dict of its fields. Sequences and arrays of numbers are numpy arrays; to be encoded, a sequence of points
or colours may be one, too: (n, 3), (n, 4). One encoder and one decoder follow the definitions in `TYPES`.

A payload begins with the 4-byte encapsulation header `00 01 00 00`. Alignment counts from the byte after it.
Every number is aligned to its own size. A string is its length with the final NUL (uint32), its bytes, NUL. A
sequence is its length (uint32) and its elements. Source: OMG formal/02-06-51 (CDR), the ROS 2 message
definitions.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.messages.definitions import TYPES

HEADER = b"\x00\x01\x00\x00"
LONGEST = 1 << 20  # bytes; a longer payload is refused

_NUMBERS = {
    name: (struct.Struct(f"<{code}"), np.dtype(f"<{kind}"))
    for name, code, kind in (
        ("int8", "b", "i1"),
        ("uint8", "B", "u1"),
        ("uint16", "H", "u2"),
        ("int32", "i", "i4"),
        ("uint32", "I", "u4"),
        ("int64", "q", "i8"),
        ("uint64", "Q", "u8"),
        ("float32", "f", "f4"),
        ("float64", "d", "f8"),
    )
}
_ARRAY = re.compile(r"(.+)\[(\d*)\]")

Message = dict[str, Any]


@cache
def _split(kind: str) -> tuple[str, int | None]:
    """Splits a type: "float64[36]" gives ("float64", 36). The count is 0 for a sequence, None for one element."""
    match = _ARRAY.fullmatch(kind)
    return (kind, None) if match is None else (match[1], int(match[2] or 0))


@cache
def _numbers(kind: str) -> np.dtype[Any] | None:
    """The type of a number, or of all the numbers of a message that holds nothing else; None of any other."""
    if kind in _NUMBERS:
        return _NUMBERS[kind][1]
    kinds = {inner for _, inner in TYPES.get(kind, ())}
    return _NUMBERS[kinds.pop()][1] if len(kinds) == 1 and kinds <= _NUMBERS.keys() else None


@cache
def definition(kind: str) -> str:
    """The message's definition as text, with those of the messages in it: the `ros2msg` encoding of MCAP."""
    kinds = [kind]
    for outer in kinds:  # grows: breadth first, each once
        kinds += [k for _, t in TYPES[outer] if (k := _split(t)[0]) in TYPES and k not in kinds]
    texts = ["".join(f"{_short(inner)} {name}\n" for name, inner in TYPES[k]) for k in kinds]
    return "".join(
        (f"{'=' * 80}\nMSG: {_short(k)}\n" if i else "") + text
        for i, (k, text) in enumerate(zip(kinds, texts, strict=True))
    )


def _short(kind: str) -> str:
    return kind.replace("/msg/", "/")


def encode(kind: str, message: Mapping[str, Any]) -> bytes:
    """Encodes a message and returns the payload.

    Args:
        kind: a name in TYPES, e.g. "sensor_msgs/msg/JointState".
        message: all its fields.
    """
    out = bytearray(HEADER)
    _write(out, kind, message)
    return bytes(out)


def _pad(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - len(HEADER)) % size)


def _write(out: bytearray, kind: str, value: Any) -> None:
    base, count = _split(kind)
    if count is not None:
        if count and len(value) != count:
            raise ValueError(f"{kind}: {len(value)} elements")
        if not count:
            _write(out, "uint32", len(value))
        dtype = _numbers(base)
        if dtype is not None and (base in _NUMBERS or isinstance(value, np.ndarray)):
            if len(value):
                _pad(out, dtype.itemsize)
                out += np.asarray(value, dtype).tobytes()
        else:
            for element in value:
                _write(out, base, element)
    elif base in _NUMBERS:
        packer = _NUMBERS[base][0]
        _pad(out, packer.size)
        out += packer.pack(value)
    elif base == "bool":
        out.append(bool(value))
    elif base == "string":
        content = value.encode()
        _write(out, "uint32", len(content) + 1)
        out += content + b"\0"
    else:
        for name, inner in TYPES[base]:
            _write(out, inner, value[name])


def is_cdr(payload: bytes) -> bool:
    """Whether a payload begins as little-endian CDR. Its options are no matter: writers say in the lowest two bits how
    many bytes of padding are at the end (DDS-XTypes 1.3, 7.6.3.1.2), and the rest isn't for a reader to judge.
    """
    return len(payload) >= len(HEADER) and payload[:2] == HEADER[:2]


def decode(kind: str, payload: bytes) -> Message:
    """Decodes a payload and returns the message's fields.

    Args:
        kind: a name in TYPES.
        payload: with its encapsulation header; up to 3 bytes of padding may follow the message.
    Raises:
        RequestError: it isn't a little-endian CDR payload of that message, or it is too short or too long.
    """
    if kind not in TYPES:
        raise RequestError(f"payload '{kind}'", "this message type isn't spoken here", nearest(kind, TYPES))
    if len(payload) > LONGEST:
        raise _bad(kind, f"{len(payload)} bytes are too long for it (at most {LONGEST})")
    if not is_cdr(payload):
        raise _bad(kind, f"it begins with '{payload[:4].hex(' ')}' and not with 00 01 00 00 (CDR, little endian)")
    reader = _Reader(kind, memoryview(payload)[len(HEADER) :])
    message: Message = reader.read(kind)
    if len(payload) - len(HEADER) - reader.at > 3:
        raise _bad(kind, f"{len(payload) - len(HEADER) - reader.at} bytes follow its end")
    return message


def _bad(kind: str, problem: str) -> RequestError:
    return RequestError(f"payload '{kind}'", problem, "Send the ROS 2 CDR bytes of that message")


class _Reader:
    """Reads values from a payload and keeps the position."""

    def __init__(self, kind: str, data: memoryview) -> None:
        self._kind, self._data, self.at = kind, data, 0

    def read(self, kind: str) -> Any:
        base, count = _split(kind)
        if count is None:
            return self._one(base)
        if not count:
            count = self._one("uint32")
        if base in _NUMBERS:
            dtype = _NUMBERS[base][1]
            if count == 0:
                return np.empty(0, dtype)
            return np.frombuffer(self._take(count * dtype.itemsize, dtype.itemsize), dtype).copy()
        if count > len(self._data) - self.at:  # an element has at least one byte
            raise _bad(self._kind, f"a sequence claims {count} elements, more than there are bytes")
        return [self._one(base) for _ in range(count)]

    def _one(self, base: str) -> Any:
        if base in _NUMBERS:
            packer = _NUMBERS[base][0]
            return packer.unpack(self._take(packer.size, packer.size))[0]
        if base == "bool":
            if (value := self._take(1)[0]) > 1:
                raise _bad(self._kind, f"a bool reads {value}")
            return bool(value)
        if base == "string":
            return self._string()
        return {name: self.read(inner) for name, inner in TYPES[base]}

    def _string(self) -> str:
        content = bytes(self._take(self._one("uint32")))
        if content and not content.endswith(b"\0"):
            raise _bad(self._kind, f"the string before byte {self.at + len(HEADER)} doesn't end in NUL")
        try:
            return content[:-1].decode()
        except UnicodeDecodeError:
            raise _bad(self._kind, f"the string before byte {self.at + len(HEADER)} isn't UTF-8") from None

    def _take(self, size: int, alignment: int = 1) -> memoryview:
        start = self.at + -self.at % alignment
        if start + size > len(self._data):
            missing = start + size - len(self._data)
            raise _bad(self._kind, f"it is cut short: {missing} bytes are missing at byte {start + len(HEADER)}")
        self.at = start + size
        return self._data[start : self.at]
