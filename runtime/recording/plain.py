"""Rows and events in a form of their own, for a machine without rerun: `FILE.rrd.segments/000001.rows`.

A file is "SRLR" and its version (uint32, little endian), then records: kind (uint8), number of bytes (uint32), the
CRC-32 of these two and of the bytes (uint32), the bytes. Each file begins with the layout. A batch is one write, so a
killed process leaves whole records and at most one torn one. The last record of a finished recording says so; a folder
without it isn't whole.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from enum import IntEnum
from pathlib import Path
from typing import Final

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.events import Event, Level

ENDING: Final = ".rows"
START: Final = b"SRLR" + struct.pack("<I", 1)
_HEAD: Final = struct.Struct("<BII")
_BEFORE: Final = struct.Struct("<BI")
_LAST: Final = struct.Struct("<q")


class Kind(IntEnum):
    """What a record holds."""

    LAYOUT = 1  # the layout's JSON
    ROWS = 2  # a block of rows (srl.runtime.recording.blocks)
    EVENTS = 3  # a JSON list of [sequence number, time (ns), level, cycle, text]
    END = 4  # the number of the recording's last row (int64)


_KINDS: Final = frozenset(Kind)


def _check(kind: int, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(_BEFORE.pack(kind, len(data))))


def record(kind: Kind, data: bytes) -> bytes:
    """One record's bytes."""
    return _HEAD.pack(kind, len(data), _check(kind, data)) + data


def events_record(numbers: Sequence[int], events: Sequence[Event]) -> bytes:
    """The record of some events, with their sequence numbers."""
    rows = [[n, e.time, e.level.name, e.cycle, e.text] for n, e in zip(numbers, events, strict=True)]
    return record(Kind.EVENTS, json.dumps(rows).encode())


def events_of(data: bytes) -> dict[int, Event]:
    """The events of a record by sequence number. Raises ValueError: it holds something else."""
    try:
        rows = json.loads(data)
        return {int(n): Event(int(time), Level[level], int(cycle), str(text)) for n, time, level, cycle, text in rows}
    except (TypeError, KeyError, RecursionError) as error:
        raise ValueError(str(error)) from None


def end_record(last: int) -> bytes:
    """The record that ends a recording. `last`: the number of its last row."""
    return record(Kind.END, _LAST.pack(last))


def last_of(data: bytes) -> int:
    """The number in an end's record. Raises ValueError: it holds something else."""
    try:
        return int(_LAST.unpack(data)[0])
    except struct.error as error:
        raise ValueError(str(error)) from None


def ended(files: Sequence[Path]) -> bool:
    """Whether a folder's files, the oldest first, are of this form and end a recording."""
    if not files or files[-1].suffix != ENDING:
        return False
    with files[-1].open("rb") as file:
        size = _HEAD.size + _LAST.size
        file.seek(max(file.seek(0, 2) - size, 0))
        data = file.read()
    return len(data) == size and data == record(Kind.END, data[_HEAD.size :])


def is_plain(path: Path, shown: Path) -> bool:
    """Whether a file has this form, by its name or its beginning: either may be lost.

    Args:
        path: where it can be read; `shown`: its name.
    """
    if not path.is_file():
        return False
    if shown.suffix == ENDING:
        return True
    with path.open("rb") as file:
        return file.read(4) == START[:4]


def records(path: Path, shown: Path) -> Iterator[tuple[Kind, bytes]]:
    """Yields each record that proves itself, also those behind a damaged part.

    Args:
        path: where it can be read; `shown`: its name, for errors.
    Raises:
        RecordingError: it was written by another version.
    """
    content = path.read_bytes()
    if content[:4] == START[:4] and len(content) >= len(START) and content[: len(START)] != START:
        version = struct.unpack_from("<I", content, 4)[0]
        problem = f"its rows have the form {version}, this srl reads 1"
        raise RecordingError(str(shown), problem, "Read it with the version of srl that wrote it")
    at = len(START)
    while at + _HEAD.size <= len(content):
        kind, length, check = _HEAD.unpack_from(content, at)
        end = at + _HEAD.size + length
        if kind in _KINDS and end <= len(content) and _check(kind, data := content[at + _HEAD.size : end]) == check:
            yield Kind(kind), data
            at = end
        else:
            at += 1  # the next record is somewhere behind


def size_of(data: bytes) -> int:
    """The number of bytes that a record with these data takes in a file."""
    return _HEAD.size + len(data)


def layout_of(files: Sequence[Path]) -> str:
    """The layout's JSON of the first file that still has it; "" if none has."""
    for file in files:
        for kind, data in records(file, file) if is_plain(file, file) else ():
            if kind is Kind.LAYOUT:
                return data.decode(errors="replace")
    return ""
