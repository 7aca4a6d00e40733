"""Reads numbers and struct arrays from MATLAB files of version 5 (save -v6 and -v7)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, Literal, cast

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import read_regular

_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX: Final = 14
_COMPRESSED: Final = 15
_STRUCT: Final = 2
_NUMBERS: Final = range(6, 16)
_Order = Literal["<", ">"]
_Element = tuple[int, bytes]
_MOST: Final = 1 << 28  # greatest size of the file, and of an unpacked variable, bytes


def read_mat5(path: Path) -> dict[str, Any]:
    """Reads the variables: arrays of numbers as numpy arrays; struct arrays as lists of dicts, in MATLAB's order.

    Variables of other classes (cells, text, sparse) are left out.

    Raises:
        RecordingError: not such a file, or incomplete.
    """
    try:
        data = read_regular(path, _MOST)
        if data[:10] != b"MATLAB 5.0" or len(data) < 128:
            raise ValueError("it doesn't begin with 'MATLAB 5.0'")
        order = cast(_Order, {b"IM": "<", b"MI": ">"}[data[126:128]])
        out: dict[str, Any] = {}
        for element in _elements(data[128:], order, padded=False):
            for kind, payload in _unpacked(*element, order):
                if kind == _MATRIX:
                    name, value = _matrix(payload, order)
                    if value is not None:
                        out[name] = value
    except (OSError, ValueError, KeyError, IndexError, struct.error, zlib.error, RecursionError) as error:
        raise RecordingError(
            str(path), f"it can't be read as a MATLAB file of version 5 ({error})", "Save it with 'save -v7'"
        ) from error
    return out


def _elements(data: bytes, order: _Order, *, padded: bool) -> Iterator[_Element]:
    """(type, payload) of consecutive elements; compressed ones aren't padded."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(order + "II", data, at)
        if kind >> 16:  # the small format: the size in the upper half, four bytes of payload
            size, kind = kind >> 16, kind & 0xFFFF
            if size > 4:
                raise ValueError("an element of the small form is too long")
            yield kind, data[at + 4 : at + 4 + size]
            at += 8
            continue
        if at + 8 + size > len(data):
            raise ValueError("the file is cut short")
        yield kind, data[at + 8 : at + 8 + size]
        at += 8 + (-(-size // 8) * 8 if padded or kind != _COMPRESSED else size)


def _unpacked(kind: int, payload: bytes, order: _Order) -> Iterable[_Element]:
    """Unpacks a compressed element, which holds one other element."""
    if kind != _COMPRESSED:
        return [(kind, payload)]
    return _elements(zlib.decompressobj().decompress(payload, _MOST), order, padded=True)


def _numbers(kind: int, payload: bytes, order: _Order) -> Any:
    return np.frombuffer(payload, np.dtype(_TYPES[kind]).newbyteorder(order))


def _matrix(payload: bytes, order: _Order) -> tuple[str, Any]:
    parts = list(_elements(payload, order, padded=True))
    if len(parts) < 3:
        return "", None
    (flags_kind, flags), (size_kind, size), (_, name) = parts[:3]
    kind = int(_numbers(flags_kind, flags, order)[0]) & 0xFF
    shape = tuple(int(v) for v in _numbers(size_kind, size, order))
    if kind in _NUMBERS and len(parts) > 3:
        values = _numbers(*parts[3], order).astype(float)
        return name.decode(), values.reshape(shape, order="F")
    if kind == _STRUCT:
        width = int(_numbers(*parts[3], order)[0])
        text = parts[4][1]
        names = [text[i : i + width].split(b"\0")[0].decode() for i in range(0, len(text), width)]
        values = [_matrix(part, order)[1] for _, part in parts[5:]]
        rows = [dict(zip(names, values[i : i + len(names)], strict=True)) for i in range(0, len(values), len(names))]
        return name.decode(), rows
    return name.decode(), None
