"""Rows and events in a form of their own, for a machine without rerun: `FILE.rrd.segments/000001.rows`.

A file is "SRLR" and its version (uint32, little endian), then records: kind (uint8), number of bytes (uint32), their
CRC-32 (uint32), the bytes. Each file begins with the layout. A batch is one write, so a killed process leaves whole
records and at most one torn one.
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
MOST: Final = 1 << 28  # bytes of a record; beyond it the length itself is damaged
_HEAD: Final = struct.Struct("<BII")


class Kind(IntEnum):
    """What a record holds."""

    LAYOUT = 1  # the layout's JSON
    ROWS = 2  # a block of rows (srl.runtime.recording.blocks)
    EVENTS = 3  # a JSON list of [sequence number, time (ns), level, cycle, text]


def record(kind: Kind, data: bytes) -> bytes:
    """One record's bytes."""
    return _HEAD.pack(kind, len(data), zlib.crc32(data)) + data


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


def is_plain(path: Path, shown: Path) -> bool:
    """Whether a file has this form, whatever its name is; by its name, if not even its beginning was written.

    Args:
        path: where it can be read; `shown`: its name.
    """
    if not path.is_file():
        return False
    with path.open("rb") as file:
        start = file.read(4)
    return start == START[:4] if len(start) == 4 else shown.suffix == ENDING


def records(path: Path, shown: Path) -> Iterator[tuple[Kind, bytes, int]]:
    """Yields each whole record, and where it ends. What is torn, or damaged, ends the file.

    Args:
        path: where it can be read; `shown`: its name, for errors.
    Raises:
        RecordingError: it was written by another version.
    """
    with path.open("rb") as file:
        start = file.read(len(START))
        if len(start) == len(START) and start != START:
            version = struct.unpack_from("<I", start, 4)[0]
            problem = f"its rows have the form {version}, this srl reads 1"
            raise RecordingError(str(shown), problem, "Read it with the version of srl that wrote it")
        end = len(START)
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            kind, length, check = _HEAD.unpack(head)
            if length > MOST or kind not in tuple(Kind):
                return
            data = file.read(length)
            if len(data) < length or zlib.crc32(data) != check:
                return
            end += _HEAD.size + length
            yield Kind(kind), data, end
