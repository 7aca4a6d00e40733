"""Rows packed without loss: a block holds some rows column by column, and proves itself by a checksum.

Most of a row's words are constant for a while, or are another word: a signal that a second part passes on, a command
that is measured a cycle later. Such a column is kept as a reference. A guarded command is kept as its difference from
the asked one. Every other column is coded by pcodec, which keeps each bit, those of a NaN too.

A block, little endian: "SRLB", version (uint16), two unused bytes, columns (uint32; the first is the sequence number),
rows (uint32), CRC-32 of the columns' bytes (uint32); then for each column a kind (uint8) and what that kind needs.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from pcodec import ChunkConfig, DeltaSpec, ModeSpec, standalone

from srl.runtime.ipc.layout import Layout, Words

MOST = 1 << 14  # rows in a block: what a reader holds at once
VERSION = 1
_HEAD = struct.Struct("<4sHxxIII")
_MAGIC = b"SRLB"
_SMALL = ChunkConfig(compression_level=6)  # a tenth of a percent more than 8, and two thirds of its time
_QUICK = ChunkConfig(compression_level=0, mode_spec=ModeSpec.classic(), delta_spec=DeltaSpec.try_consecutive(1))


class _Kind(IntEnum):
    CONSTANT = 0  # its value
    SAME = 1  # the column that it equals
    DELAYED = 2  # the column that it follows by a row, its first value
    NUMBERS = 3  # length, pcodec's bytes of int64
    FLOATS = 4  # the same, of float64
    DIFFERENCE = 5  # a column, length, pcodec's bytes of the difference from it


_KINDS = tuple(_Kind)  # by number; quicker than the enum's own look-up
_BODY = {
    _Kind.CONSTANT: struct.Struct("<q"),
    _Kind.SAME: struct.Struct("<I"),
    _Kind.DELAYED: struct.Struct("<Iq"),
    _Kind.NUMBERS: struct.Struct("<I"),
    _Kind.FLOATS: struct.Struct("<I"),
    _Kind.DIFFERENCE: struct.Struct("<II"),
}


def kin(layout: Layout) -> dict[int, int]:
    """Which words are nearly others: of each guarded command's word, that of the asked one."""
    found: dict[int, int] = {}
    for field in layout.fields.values():
        asked = layout.fields.get(field.name.removesuffix(".applied")) if field.role == "applied" else None
        if asked is not None and asked.size == field.size:
            found |= {layout.ints + field.offset + i: layout.ints + asked.offset + i for i in range(field.size)}
    return found


def pack(sequence: Words, rows: Words, ints: int, near: Mapping[int, int], quick: bool = False) -> bytes:
    """Packs rows (k, width) with their sequence numbers (k,), 0 < k <= MOST.

    Args:
        ints: how many of the first words are integers; the others are float64.
        near: for a word, another of whose value it is close; see `kin`.
        quick: for a quarter of the time, a fifth larger: what is soon packed again.
    """
    config = _QUICK if quick else _SMALL
    columns = np.ascontiguousarray(np.column_stack([sequence, rows]).T)
    count, k = columns.shape
    constant = (columns == columns[:, :1]).all(axis=1)
    same = _repeated(columns, constant)
    delayed = _delayed(columns, [c for c in range(count) if not constant[c] and c not in same])
    parts = [_HEAD.pack(_MAGIC, VERSION, count, k, zlib.crc32(columns.tobytes()))]

    def add(kind: _Kind, *what: int, data: bytes = b"") -> None:
        parts.extend((bytes((kind,)), _BODY[kind].pack(*what), data))

    for c, column in enumerate(columns):
        if constant[c]:
            add(_Kind.CONSTANT, int(column[0]))
        elif c in same:
            add(_Kind.SAME, same[c])
        elif c in delayed:
            add(_Kind.DELAYED, delayed[c], int(column[0]))
        else:
            kind = _Kind.FLOATS if c > ints else _Kind.NUMBERS
            data = _coded(column.view(np.float64) if kind is _Kind.FLOATS else column, config)
            other = near.get(c - 1, -1) + 1
            other = same.get(other, other)
            if 0 < other < c and not constant[other] and other not in delayed:
                with np.errstate(over="ignore"):
                    short = _coded(column - columns[other], config)
                if len(short) < len(data):
                    add(_Kind.DIFFERENCE, other, len(short), data=short)
                    continue
            add(kind, len(data), data=data)
    return b"".join(parts)


def unpack(data: bytes) -> tuple[Words, Words]:
    """Returns the sequence numbers (k,) and rows (k, width) of a block. Raises ValueError: it is damaged."""
    try:
        columns, check = _columns(data)
    except (struct.error, RuntimeError, TypeError, IndexError, KeyError, MemoryError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None
    if zlib.crc32(columns.tobytes()) != check:
        raise ValueError("its checksum is another")
    rows = np.ascontiguousarray(columns[1:].T)
    return columns[0].copy(), rows


def _columns(data: bytes) -> tuple[Words, int]:
    magic, version, count, k, check = _HEAD.unpack_from(data)
    if magic != _MAGIC or version != VERSION:
        raise ValueError("it isn't a block of this version")
    if not 0 < k <= MOST or count * _BODY[_Kind.SAME].size > len(data):
        raise ValueError(f"it can't hold {k} rows of {count} words")
    columns = np.empty((count, k), np.int64)
    later: list[tuple[_Kind, int, int, int, NDArray[np.int64] | None]] = []
    at = _HEAD.size
    for c in range(count):
        kind = _KINDS[data[at]]
        what = _BODY[kind].unpack_from(data, at + 1)
        at += 1 + _BODY[kind].size
        coded = None
        if kind >= _Kind.NUMBERS:
            coded = standalone.simple_decompress(data[at : at + what[-1]])
            if coded is None or coded.shape != (k,) or coded.itemsize != 8:
                raise ValueError("a column has another length")
            coded = coded.view(np.int64)
            at += what[-1]
        if kind in (_Kind.CONSTANT, _Kind.NUMBERS, _Kind.FLOATS):
            columns[c] = what[0] if coded is None else coded
        else:
            later.append((kind, c, what[0], what[-1], coded))
    # A difference is from a column that stands for itself, and a delayed or repeated one may be of a difference.
    for kind, c, other, first, coded in sorted(later, key=lambda item: -item[0]):
        if kind is _Kind.DIFFERENCE and coded is not None:
            columns[c] = coded + columns[other]
        elif kind is _Kind.DELAYED:
            columns[c, 0], columns[c, 1:] = first, columns[other, :-1]
        else:
            columns[c] = columns[other]
    return columns, check


def _repeated(columns: Words, constant: NDArray[np.bool_]) -> dict[int, int]:
    """For a column that equals an earlier one, the first such."""
    found, firsts = {}, dict[tuple[int, ...], list[int]]()
    for c in np.flatnonzero(~constant):
        alike = firsts.setdefault(_mark(columns[c]), [])
        first = next((other for other in alike if np.array_equal(columns[other], columns[c])), None)
        if first is None:
            alike.append(int(c))
        else:
            found[int(c)] = first
    return found


def _delayed(columns: Words, own: list[int]) -> dict[int, int]:
    """For a column whose values are another's of a row before, that one. Nobody follows a follower."""
    marks: dict[tuple[int, ...], list[int]] = {}
    for c in own:
        marks.setdefault(_mark(columns[c, :-1]), []).append(c)
    found: dict[int, int] = {}
    followed: set[int] = set()
    for c in own:
        for other in marks.get(_mark(columns[c, 1:]), ()):
            free = other != c and other not in found and c not in followed
            if free and np.array_equal(columns[other, :-1], columns[c, 1:]):
                found[c] = other
                followed.add(other)
                break
    return found


def _mark(column: Words) -> tuple[int, ...]:
    """Some of a column's values: equal for equal columns."""
    k = len(column)
    return tuple(column[[0, k // 5, k // 3, k // 2, k - 1]].tolist()) if k else ()


def _coded(column: NDArray[np.int64] | NDArray[np.float64], config: ChunkConfig) -> bytes:
    data: bytes = standalone.simple_compress(np.ascontiguousarray(column), config)
    return data
