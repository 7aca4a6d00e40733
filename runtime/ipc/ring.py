"""A ring of fixed-size rows in a plain mmap'd file: one writer, any number of readers, no locks.

The writer never waits and does not know its readers. The file outlives every process, so it serves as the black
box. A row has its sequence number at both ends, so a reader recognises a torn or overwritten row.
`multiprocessing.shared_memory` is not suitable: on Python 3.11 a killed reader unlinks it.

File: one 4096-byte page of header (int64 words, see the indices below), then `capacity` rows of
`2 + width` words of 8 bytes: sequence number, payload, sequence number. Sequence numbers start at 1.
The byte order is the machine's. The ring relies on stores becoming visible in program order (x86-64).
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import HostError, RecordingError
from srl.runtime.ipc import private_file

PAGE = 4096
MAGIC = int.from_bytes(b"SRLRING1", "little")
# Indices of the header's words.
_MAGIC, _WIDTH, _CAPACITY, _HEAD, _BEAT, _CONSUMED, _CLOSED = range(7)
# Values of `_CLOSED`, beside 0.
_SETTLED, _UNSAVED = 1, 2

Words = NDArray[np.int64]


def file_size(width: int, capacity: int) -> int:
    """Bytes of a ring of `capacity` rows of `width` payload words."""
    return PAGE + capacity * (width + 2) * 8


class _Ring:
    """The mapped file; see the module's docstring."""

    def __init__(self, path: Path, writable: bool, width: int | None) -> None:
        """`width`: what a row must hold; None: whatever the header says. Raises RecordingError."""
        self.path = path
        try:
            descriptor = os.open(path, os.O_RDWR if writable else os.O_RDONLY)
        except OSError as error:
            raise RecordingError(str(path), f"no ring can be opened here: {error.strerror}", "Is the run up?") from None
        try:
            size = os.fstat(descriptor).st_size
            if size < PAGE:
                raise RecordingError(str(path), "the file is too short to be a ring", "It wasn't written by srl")
            # The writer's pages are mapped now: else each is a fault in the loop, until all rows were written once.
            flags = mmap.MAP_SHARED | (mmap.MAP_POPULATE if writable else 0)
            protection = mmap.PROT_READ | (mmap.PROT_WRITE if writable else 0)
            self._map = mmap.mmap(descriptor, size, flags, protection)
        except OSError as error:
            raise RecordingError(str(path), f"the ring can't be mapped: {error.strerror}", "Free memory") from None
        finally:
            os.close(descriptor)
        self.header: Words = np.frombuffer(self._map, np.int64, PAGE // 8)
        if self.header[_MAGIC] != MAGIC:
            raise RecordingError(str(path), "the file isn't a ring", "It wasn't written by this version of srl")
        self.width, self.capacity = int(self.header[_WIDTH]), int(self.header[_CAPACITY])
        consumed, head = self.consumed, self.head  # in this order: `head` is written first
        whole = self.width > 0 and self.capacity > 0 and size == file_size(self.width, self.capacity)
        if not whole or not 0 <= consumed <= head:
            problem = f"the ring is damaged: {size} bytes aren't {self.capacity} rows of {self.width} words"
            if whole:
                problem = f"the ring is damaged: {consumed} of {head} rows are said to be recorded"
            raise RecordingError(str(path), problem, "Its rows can't be read; use another recording")
        if width is not None and self.width != width:
            problem = f"its rows are {self.width} words wide, not {width}"
            raise RecordingError(str(path), problem, "Ring and layout are of different runs")
        words = np.frombuffer(self._map, np.int64, self.capacity * (self.width + 2), PAGE)
        self.rows: Words = words.reshape(self.capacity, self.width + 2)

    @property
    def head(self) -> int:
        """The sequence number of the newest complete row; 0 before the first."""
        return int(self.header[_HEAD])

    @property
    def beat(self) -> int:
        """The time of the writer's newest sign of life, CLOCK_MONOTONIC ns."""
        return int(self.header[_BEAT])

    @property
    def consumed(self) -> int:
        """The sequence number up to which rows are in the recording."""
        return int(self.header[_CONSUMED])

    @property
    def closed(self) -> bool:
        """True once no row will follow."""
        return bool(self.header[_CLOSED])

    @property
    def settled(self) -> bool:
        """True once the writer has ended by itself, or its rows were saved after its death."""
        return int(self.header[_CLOSED]) == _SETTLED

    @property
    def content(self) -> memoryview:
        """The whole file, as it is now."""
        return memoryview(self._map)

    def close(self) -> None:
        """Unmaps the file. The file itself remains."""
        del self.header, self.rows
        try:
            self._map.close()
        except BufferError:  # a caller still holds a view; the map is freed with it
            pass

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RingWriter(_Ring):
    """The single writer of a ring."""

    @classmethod
    def create(cls, path: Path, width: int, capacity: int) -> RingWriter:
        """Makes a new file, replacing an old one, for `capacity` rows of `width` payload words."""
        scratch = path.with_suffix(".new")
        scratch.unlink(missing_ok=True)
        with open(private_file.create(scratch), "wb") as file:
            header = np.zeros(PAGE // 8, np.int64)
            header[[_MAGIC, _WIDTH, _CAPACITY]] = MAGIC, width, capacity
            file.write(header.tobytes())
            size = file_size(width, capacity)
            try:
                os.posix_fallocate(file.fileno(), 0, size)  # reserve the space now: otherwise SIGBUS in the loop
            except OSError as error:
                file.close()
                scratch.unlink()
                problem = f"there is no room for {size >> 20} MiB of rows: {error.strerror}"
                raise HostError(str(path), problem, "Make room there, or set SRL_RUNTIME_DIR") from None
        scratch.rename(path)
        return cls(path)

    def __init__(self, path: Path, width: int | None = None) -> None:
        """Opens an existing ring to continue writing at its end."""
        super().__init__(path, writable=True, width=width)

    def append(self, payload: Words) -> int:
        """Writes one row of `width` words; returns its sequence number."""
        sequence = int(self.header[_HEAD]) + 1
        row = self.rows[(sequence - 1) % self.capacity]
        row[0] = 0  # the row is torn from here until both ends agree again
        row[1:-1] = payload
        row[-1] = sequence
        row[0] = sequence
        self.header[_HEAD] = sequence
        return sequence

    def touch(self, now: int) -> None:
        """Writes a sign of life."""
        self.header[_BEAT] = now

    def finish(self) -> None:
        """Marks the ring as closed: no row will follow."""
        self.header[_CLOSED] = _SETTLED


class RingReader(_Ring):
    """A reader of a ring, with its own read position."""

    def __init__(self, path: Path, after: int = 0, marks: bool = False, width: int | None = None) -> None:
        """Opens the ring to read rows with sequence numbers above `after`. `marks`: for `set_consumed` and `finish`."""
        super().__init__(path, writable=marks, width=width)
        self.sequence = after
        self.lost = 0

    def take(self, most: int = 4096) -> Words:
        """Returns copies of the next rows' payloads, shape (k, width) with k <= most; k = 0 if there are none.

        Rows that were overwritten before this reader read them are counted in `lost` and skipped.
        Afterwards `self.sequence` is the sequence number of the last row returned.
        """
        while True:
            head = self.head
            oldest = max(head - self.capacity + 1, 1)
            if self.sequence + 1 < oldest:
                self.lost += oldest - 1 - self.sequence
                self.sequence = oldest - 1
            count = min(head - self.sequence, most)
            if count <= 0:
                return np.empty((0, self.width), np.int64)
            wanted = np.arange(self.sequence + 1, self.sequence + count + 1)
            slots = (wanted - 1) % self.capacity
            rows = self.rows[slots]
            whole = (rows[:, 0] == wanted) & (rows[:, -1] == wanted) & (self.rows[slots, 0] == wanted)
            if whole.all():
                self.sequence += count
                return rows[:, 1:-1]
            # The writer overwrote the oldest rows while they were copied. Continue after the last bad one.
            bad = int(np.flatnonzero(~whole)[-1]) + 1
            self.lost += bad
            self.sequence += bad

    def newest(self) -> Words | None:
        """Returns the payload (width,) of the newest whole row and keeps the position; None before the first row."""
        for _ in range(8):
            head = self.head
            if head == 0:
                return None
            row = self.rows[(head - 1) % self.capacity].copy()
            if row[0] == row[-1] == head:
                return row[1:-1]
        return None

    def set_consumed(self, sequence: int) -> None:
        """Sets the recorder's mark: rows up to this sequence number are safe on disk."""
        self.header[_CONSUMED] = sequence

    def finish(self, saved: bool) -> None:
        """Marks the ring as closed in place of a dead writer. `saved`: whether its rows are safe elsewhere."""
        self.header[_CLOSED] = _SETTLED if saved else _UNSAVED
