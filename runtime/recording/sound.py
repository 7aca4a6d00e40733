"""Which messages of a `.rrd` stream can be given to rerun: its reader ends the process at an unknown Arrow type.

The fields of a message with data (Protobuf, found from the bytes of rerun 0.41): 2 compression (1 none, 2 LZ4 block),
3 size before it, 5 payload, an Arrow stream.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from srl.runtime.recording.framing import HEADER, MESSAGE, walk

DATA: Final = 2  # the kind
_COMPRESSION, _SIZE, _PAYLOAD = 2, 3, 5
_LZ4: Final = 2
_MOST: Final = 1 << 30  # bytes
_HEADER, _BUFFERS = 2, 2  # fields of Arrow's Message and RecordBatch
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5  # Protobuf's wire types


def sound(stream: Path) -> bool:
    """Whether all messages with data of a stream hold whole Arrow data."""
    before = HEADER
    with open(stream, "rb") as file:
        for kind, end in walk(file, stream.stat().st_size):
            if kind == DATA:
                file.seek(before + MESSAGE.size)
                if not _holds_data(memoryview(file.read(end - before - MESSAGE.size))):
                    return False
            before = end
    return True


def _holds_data(message: memoryview) -> bool:
    try:
        fields = _fields(message)
        payload = fields[_PAYLOAD]
        if fields[_COMPRESSION] == _LZ4:
            if fields[_SIZE] > _MOST:
                return False
            payload = _CODEC.decompress(payload, fields[_SIZE])
        schema, *batches = pa.ipc.MessageReader.open_stream(payload)
        known = pa.ipc.read_schema(schema)
        if not all(map(_named, known)):
            return False
        for batch in batches:
            pa.ipc.read_record_batch(batch, known).validate(full=True)
            if not _has_its_buffers(batch):
                return False
    except (KeyError, IndexError, ValueError, OverflowError, TypeError, OSError, pa.ArrowException, struct.error):
        return False
    return True


def _named(field: pa.Field) -> bool:
    """Whether its name and those within it hold no NUL, which Arrow's interface in C can't carry."""
    within = (field.type.field(i) for i in range(field.type.num_fields))
    return "\0" not in field.name and all(map(_named, within))


def _has_its_buffers(batch: pa.ipc.Message) -> bool:
    """Whether all buffers of a record batch lie in it: pyarrow looks at those that it needs."""
    data = batch.metadata.to_pybytes()  # flatbuffers, whose form pyarrow has verified

    def field(table: int, number: int) -> int:
        """Where what a table's field points to begins."""
        offsets = table - struct.unpack_from("<i", data, table)[0]
        at: int = table + struct.unpack_from("<H", data, offsets + 4 + 2 * number)[0]
        return at + int(struct.unpack_from("<I", data, at)[0])

    buffers = field(field(struct.unpack_from("<I", data)[0], _HEADER), _BUFFERS)
    count = struct.unpack_from("<I", data, buffers)[0]
    start, size = np.frombuffer(data, "<i8", 2 * count, buffers + 4).reshape(-1, 2).T
    most = batch.body.size if batch.body is not None else 0
    return bool(((start >= 0) & (size >= 0) & (start <= most) & (size <= most - start)).all())


_CODEC: Final = pa.Codec("lz4_raw")


def _fields(message: memoryview) -> dict[int, Any]:
    """The fields by number, each an integer or bytes. Raises IndexError, ValueError."""
    found: dict[int, Any] = {}
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        if key & 7 == _VARINT:
            found[key >> 3], at = _varint(message, at)
            continue
        if key & 7 == _BYTES:
            size, at = _varint(message, at)
        else:
            size = {_FIXED64: 8, _FIXED32: 4}[key & 7]
        if at + size > len(message):
            raise ValueError("it ends in a field")
        found[key >> 3] = message[at : at + size]
        at += size
    return found


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = message[at]
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value, at
        if shift > 63:
            raise ValueError("a number of more than 64 bits")
