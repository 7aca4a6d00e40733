"""The framing of a `.rrd` stream, as far as salvage needs it: where whole messages end.

A stream is a header of 12 bytes ("RRF2", version, options), then messages: kind and length (uint64, little
endian), then that many bytes. Kind 0 ends a stream and contains its manifest. A footer of 32 bytes follows it:
offset and length of the manifest (uint64), checksum, "RRF2FOOT", version. This was found from the bytes of
rerun 0.41, whose own reader refuses a file that ends inside a message.
"""

from __future__ import annotations

import os
import stat
import struct
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from srl.runtime.contracts.errors import RecordingError

HEADER = 12
_MAGIC = b"RRF2"
MESSAGE = struct.Struct("<QQ")
_KINDS = range(1, 16)  # 1 store, 2 data, 3 blueprint; with room for more
_END = 0
_FOOTER = 32


def strip(stream: bytes | None) -> bytes:
    """Returns the messages of a whole stream in memory, without its header, end and footer; of none, nothing."""
    if stream is None:
        return b""
    at = HEADER
    while at + MESSAGE.size <= len(stream):
        kind, length = MESSAGE.unpack_from(stream, at)
        if kind == _END:
            break
        at += MESSAGE.size + length
    return stream[HEADER:at]


def whole(path: Path) -> int:
    """The number of bytes from the file's start that are whole messages; its size if nothing is torn.

    Raises:
        RecordingError: the file doesn't begin like a rerun stream.
    """
    about = path.stat()
    if not stat.S_ISREG(about.st_mode):
        raise RecordingError(str(path), "it is no regular file", "Give a .rrd file that srl wrote")
    size = about.st_size
    with open(path, "rb") as file:
        start = file.read(HEADER)
        magic = start[:4].rstrip(b"\0")  # zeros: the power failed before it was on the disk
        if magic != _MAGIC[: len(magic)]:
            raise RecordingError(str(path), "the file isn't a rerun recording", "Give a .rrd file that srl wrote")
        if len(start) < HEADER or magic != _MAGIC:
            return 0
        end = HEADER
        for kind, after in walk(file, size):
            if kind == _END:
                return size if after + _FOOTER == size and _has_footer(file, size) else end
            end = after
        return end


def walk(file: BinaryIO, size: int) -> Iterator[tuple[int, int]]:
    """Yields kind and end of each whole message of a file of `size` bytes. Stops before a torn or unknown message."""
    at = HEADER
    while at + MESSAGE.size <= size:
        file.seek(at)
        kind, length = MESSAGE.unpack(file.read(MESSAGE.size))
        at += MESSAGE.size + length
        if at > size or (kind != _END and kind not in _KINDS):
            return
        yield kind, at


def _has_footer(file: BinaryIO, size: int) -> bool:
    file.seek(size - _FOOTER)
    return file.read(_FOOTER)[20:28] == b"RRF2FOOT"


@dataclass(frozen=True)
class Window:
    """Whole messages of a file as a stream in memory at `path`: its bytes from `start` to `end`."""

    path: Path
    start: int
    end: int


@contextmanager
def windows(path: Path, start: int, length: int, most: int = 32 << 20) -> Iterator[Iterator[Window]]:
    """The whole messages of a file between two bytes as windows, each of at most `most` bytes or of one message.

    rerun's reader takes a path, and refuses a stream whose end is torn.
    """
    with ExitStack() as stack:
        file = stack.enter_context(open(path, "rb"))
        scratch = os.memfd_create("srl-window", os.MFD_CLOEXEC)
        stack.callback(os.close, scratch)
        yield _windows(file, start, length, most, scratch)


def _windows(file: BinaryIO, start: int, length: int, most: int, scratch: int) -> Iterator[Window]:
    ends = [end for kind, end in walk(file, length) if kind != _END]
    if not ends:
        return
    head = ends[0]  # the header, and the message that says what is recorded
    # From a byte that ends no message: from the next that does.
    start = next((end for end in ends if end >= start), head) if start else 0
    for i, end in enumerate(ends):
        if end <= start or (i + 1 < len(ends) and ends[i + 1] - start <= most):
            continue
        os.ftruncate(scratch, 0)
        os.lseek(scratch, 0, os.SEEK_SET)
        if start:
            _send(file, scratch, 0, head)
        _send(file, scratch, start, end)
        yield Window(Path(f"/proc/self/fd/{scratch}"), start, end)
        start = end


def _send(file: BinaryIO, target: int, start: int, end: int) -> None:
    while start < end:
        count = os.sendfile(target, file.fileno(), start, end - start)
        if count == 0:
            return
        start += count
