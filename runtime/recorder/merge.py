"""Merges segments into the recording as it grows: each is packed, read back and compared before it is removed.

At the end of a run nothing is packed any more: the last segments' messages become part of the file as they are.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.events import Event
from srl.runtime.ipc.layout import Words
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.framing import HEADER, strip, whole
from srl.runtime.recording.segments import GROWING, append, folder_of, is_at, numbered, write_again
from srl.runtime.recording.source import Source, last_row

_TOGETHER = 2  # segments that become one piece, if so many wait: the more at once, the less time each takes
_AT_THE_END = 8


@dataclass
class _Piece:
    """What segments become: bytes for the growing file, the last of their rows, how many are new, and the events."""

    segments: Sequence[Path]
    data: bytes = b""
    last: int = 0
    rows: int = 0
    events: set[int] = field(default_factory=set)


class Merger:
    """The growing file of one recording, `GROWING` in the folder of its segments."""

    def __init__(
        self, target: Path, text: str, prologue: bytes = b"", report: Callable[[str], None] = lambda text: None
    ) -> None:
        """Opens nothing: the first merge does.

        Args:
            target: where the recording is to be.
            text: the layout's JSON.
            prologue: with which the segments begin that needn't be packed at the end; empty: all are packed.
            report: is told what can't be drawn.
        """
        self._target, self._text, self._prologue, self._report = target, text, prologue, report
        self._ending = False
        self.path = folder_of(target) / GROWING
        self._kept = f"The segments are kept and can be read as they are: {self.path.parent}"
        self._file: int | None = None
        self._size = self._last = 0
        self.rows = 0  # in the growing file
        self.added: list[Path] = []  # segments that are in it, since the caller emptied this
        self._sent: set[int] = set()
        self._piece: _Piece | None = None  # what couldn't be written yet
        self._stream: Stream | None = None
        self._head = b""

    def merge(self, segments: Sequence[Path]) -> None:
        """Merges segments that no more is written to, the oldest first, and removes each that is safely in.

        Raises:
            RecordingError: one can't be read whole, or the recording can't be written. It and those after it stay.
        """
        try:
            if self._file is None and (segments or (self._ending and self.path.exists())):
                self._open()
            elif self._file is not None and not is_at(self._file, self.path):
                self._file = write_again(self._file, self.path)  # somebody deleted it, or moved it away
            if self._piece is not None:
                self._add(self._piece)
            waiting = [segment for segment in segments if segment not in self.added]
            most = _AT_THE_END if self._ending else _TOGETHER
            for at in range(0, len(waiting), most):
                self._piece = self._made(waiting[at : at + most])
                if self._piece is None:
                    return
                self._add(self._piece)
        except OSError as error:
            raise RecordingError(str(self.path), f"it can't be written: {error.strerror}", self._kept) from None

    def hurry(self) -> None:
        """The run has ended: a merge that is under way in another thread stops before its next step."""
        self._ending = True

    def finish(self) -> None:
        """Merges what is left, and puts the recording in its place.

        Raises:
            RecordingError: as `merge`; no row was recorded; the place is taken.
        """
        self._ending = True
        self.added.clear()  # what was written again after it was merged is removed with the others
        self.merge(numbered(self.path.parent))
        self.close()
        if not self._last and not (self.path.exists() and last_row(self.path)):
            raise RecordingError(str(self._target), "no row was recorded", "The run ended before its first cycle")
        if self._target.exists():
            raise RecordingError(str(self._target), "a recording is there already", self._kept)
        try:
            self.path.rename(self._target)
            _sync(self._target.parent)
        except OSError as error:
            raise RecordingError(str(self._target), f"it can't be finished: {error.strerror}", self._kept) from None
        with contextlib.suppress(OSError):  # somebody put something there
            self.path.parent.rmdir()

    def close(self) -> None:
        """Closes the file."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _open(self) -> None:
        """Opens the file, or goes on with that of a recorder that was killed."""
        file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
        try:
            self._size, self._last = whole(self.path), last_row(self.path)
            if self._last:
                self.rows = sum(len(sequence) for sequence, _ in Source([self.path]).blocks())
            else:
                source = Source([self.path])
                if not any(True for _ in source.blocks()) and not source.events:
                    self._size = 0  # torn in what comes before the first rows
            os.ftruncate(file, self._size)
            os.lseek(file, self._size, os.SEEK_SET)
            for folder in (self.path.parent, self._target.parent):  # before a segment goes, this file's name is kept
                _sync(folder)
        except BaseException:
            os.close(file)
            raise
        self._file = file

    def _made(self, segments: Sequence[Path]) -> _Piece | None:
        """Makes a piece of segments, and reads it back. None: it needn't be packed any more."""
        hurried, source, place = self._ending, Source(segments), str(segments[0])
        if gone := next((segment for segment in segments if not segment.exists()), None):
            raise RecordingError(str(gone), "it was deleted", "Its recorder writes it again")
        blocks = list(source.blocks())
        if source.files != list(segments):  # one went meanwhile: rows after its own must not be merged before them
            raise RecordingError(place, "a segment was deleted", "Its recorder writes it again")
        if source.text and source.text != self._text:
            raise RecordingError(place, "it belongs to another run", self._kept)
        if source.damaged:
            raise RecordingError(place, f"{source.damaged} blocks of its rows are damaged", self._kept)
        events = {n: event for n, event in sorted(source.events.items()) if n not in self._sent}
        sequence = np.concatenate([np.empty(0, np.int64), *(s for s, _ in blocks)])
        new = sequence > self._last
        if not new.any() and not events:
            return _Piece(segments)
        if self._stream is None:
            self._stream = Stream(self._text)
            self._binary = self._stream.recording.binary_stream()
            self._stream.prologue(blocks[0][1][0] if blocks else None)
            for problem in self._stream.problems:
                self._report(problem)
            self._head = self._binary.read()
            self._head = self._head[:HEADER] + strip(self._head)
        rows = np.concatenate([np.empty((0, self._stream.layout.width), np.int64), *(r for _, r in blocks)])[new]
        data = b""
        if hurried and not source.cut and new.all() and len(events) == len(source.events):
            data = self._plain(segments)
        if not data:
            self._stream.pack(sequence[new], rows)
            self._stream.events(list(events), list(events.values()))
            data = strip(self._binary.read())
            self._compare(place, data, sequence[new], rows, events)
        if self._ending and not hurried:
            return None
        self._stream.draw(sequence[new], rows)
        data += strip(self._binary.read())
        return _Piece(segments, data, int(sequence[-1]) if len(sequence) else 0, len(rows), set(events))

    def _plain(self, segments: Sequence[Path]) -> bytes:
        """The messages of segments as they are; nothing if another process began one of them."""
        found = [segment.read_bytes() for segment in segments]
        if not self._prologue or not all(data.startswith(self._prologue) for data in found):
            return b""
        return b"".join(data[len(self._prologue) :] for data in found)

    def _compare(self, place: str, data: bytes, sequence: Words, rows: Words, events: Mapping[int, Event]) -> None:
        """Reads a piece back as a reader will, and compares rows (k, width) with their numbers (k,), and events."""
        scratch = os.memfd_create("srl-piece", os.MFD_CLOEXEC)
        try:
            append(scratch, self._head + data, 0)
            copy = Source([Path(f"/proc/self/fd/{scratch}")])
            count, same = 0, True
            for s, r in copy.blocks():
                part = slice(count, count + len(s))
                same = same and np.array_equal(s, sequence[part]) and np.array_equal(r, rows[part])
                count += len(s)
            if count != len(rows) or copy.events != events or copy.text != self._text or copy.cut or not same:
                problem = f"packed it isn't complete ({count} of {len(rows)} rows)"
                raise RecordingError(place, problem, self._kept)
        finally:
            os.close(scratch)

    def _add(self, piece: _Piece) -> None:
        """Appends a piece, and removes what it was made of."""
        self._write(piece)
        piece.data = b""  # it isn't written again if a segment can't be removed
        for segment in piece.segments:
            segment.unlink(missing_ok=True)
        self.added += piece.segments
        self._last, self.rows = max(self._last, piece.last), self.rows + piece.rows
        self._sent |= piece.events
        self._piece = None

    def _write(self, piece: _Piece) -> None:
        """Appends a piece, and compares what the file now holds."""
        assert self._file is not None
        data = piece.data if self._size or not piece.data else self._head + piece.data
        if not data:
            return
        before = self._size
        self._size = append(self._file, data, before)
        try:
            os.fsync(self._file)
            if os.pread(self._file, len(data), before) != data:
                raise OSError(0, "it holds other bytes than were written")
        except OSError:
            os.ftruncate(self._file, before)
            os.lseek(self._file, before, os.SEEK_SET)
            self._size = before
            raise


def _sync(folder: Path) -> None:
    """Makes a new name in a folder last."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
