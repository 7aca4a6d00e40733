"""The framing of a `.rrd` stream, as far as salvage needs it: where whole messages end.

A stream is a header of 12 bytes ("RRF2", version, options), then messages: kind and length (uint64, little
endian), then that many bytes. Kind 0 ends a stream and contains its manifest. A footer of 32 bytes follows it:
offset and length of the manifest (uint64), checksum, "RRF2FOOT", version. This was found from the bytes of
rerun 0.41, whose own reader refuses a file that ends inside a message.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from runtime.contracts.errors import RecordingError

HEADER = 12
_MAGIC = b"RRF2"
_MESSAGE = struct.Struct("<QQ")
_KINDS = range(1, 16)  # 1 store, 2 data, 3 blueprint; with room for more
_END = 0
_FOOTER = 32


def strip(stream: bytes) -> bytes:
    """Returns the messages of a whole stream in memory, without its header, end and footer."""
    at = HEADER
    while at + _MESSAGE.size <= len(stream):
        kind, length = _MESSAGE.unpack_from(stream, at)
        if kind == _END:
            break
        at += _MESSAGE.size + length
    return stream[HEADER:at]


def whole(path: Path) -> int:
    """The number of bytes from the file's start that are whole messages; its size if nothing is torn.

    Raises:
        RecordingError: the file doesn't begin like a rerun stream.
    """
    size = path.stat().st_size
    with open(path, "rb") as file:
        start = file.read(HEADER)
        if start[:4] != _MAGIC[: len(start)]:
            raise RecordingError(str(path), "the file isn't a rerun recording", "Give a .rrd file that srl wrote")
        if len(start) < HEADER:
            return 0
        end = HEADER
        for kind, after in _walk(file, size):
            if kind == _END:
                return size if after + _FOOTER == size and _has_footer(file, size) else end
            end = after
        return end


def _walk(file: BinaryIO, size: int) -> Iterator[tuple[int, int]]:
    """Yields kind and end of each whole message. Stops before a torn or unknown message."""
    at = HEADER
    while at + _MESSAGE.size <= size:
        file.seek(at)
        kind, length = _MESSAGE.unpack(file.read(_MESSAGE.size))
        at += _MESSAGE.size + length
        if at > size or (kind != _END and kind not in _KINDS):
            return
        yield kind, at


def _has_footer(file: BinaryIO, size: int) -> bool:
    file.seek(size - _FOOTER)
    return file.read(_FOOTER)[20:28] == b"RRF2FOOT"


def copy_prefix(source: Path, target: Path, length: int) -> None:
    """Copies the first `length` bytes."""
    with open(source, "rb") as one, open(target, "wb") as other:
        done = 0
        while done < length:
            count = os.sendfile(other.fileno(), one.fileno(), done, length - done)
            if count == 0:
                return
            done += count
