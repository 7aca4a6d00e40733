"""Reads recorded rows file by file: cuts torn tails, drops duplicates, never holds more than a window in memory.

rerun is loaded for its own files only; those of the plain form (srl.runtime.recording.plain) need none of it. A
recording can be read while it grows: its files are held open from the beginning, so none can vanish.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.events import Event
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.recording import plain
from srl.runtime.recording.blocks import unpack
from srl.runtime.recording.format import (
    APPLICATION,
    BLOCK,
    COLUMNS_ONLY,
    EVENT,
    EVENTS,
    FORMAT,
    LEVELS,
    OLD_EVENT,
    OLD_EVENTS,
    PROPERTY,
    ROWS,
)
from srl.runtime.recording.framing import Window, whole, windows
from srl.runtime.recording.segments import ENDING, listed

if TYPE_CHECKING:
    import pyarrow as pa

    from srl.runtime.recording.columns import Assembler

_MUCH = 64 << 20  # bytes of columns before rows are made of them
_TAIL = 64 << 20  # bytes at a file's end that hold its last rows
_LOOKS = 5  # at a folder whose files are merged meanwhile
_ARCHETYPES = {EVENTS: EVENT, OLD_EVENTS: OLD_EVENT}
_LEVELS = {text: level for level, text in LEVELS.items()}
Chunk = tuple[str, "pa.RecordBatch"]


class Source:
    """A merged recording or segments, in their order.

    Attributes:
        text: the layout's JSON. Like `layout`, it is known once a block has been returned or all have been read.
        events: the events read so far, by sequence number.
        cut: number of bytes that are torn or spoilt in the files read so far.
        damaged: blocks of rows that didn't prove themselves; their rows are left out.
        last: the number of the last row, where a recording in the plain form says that it is whole; else None.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = list(files)
        self.text = ""
        self.layout: Layout | None = None
        self.events: dict[int, Event] = {}
        self.cut = self.damaged = 0
        self.last: int | None = None
        self._assembler: Assembler | None = None  # of format 1
        self._rows: list[tuple[Words, Words]] = []

    def blocks(self) -> Iterator[tuple[Words, Words]]:
        """Yields sequence numbers (k,), ascending throughout, and rows (k, width).

        Raises:
            RecordingError: a file isn't a recording of srl, or belongs to another version or run than the first.
        """
        last = 0
        with ExitStack() as stack:
            for file, held in self._held(stack):
                for sequence, rows in self._read(file, held):
                    new = sequence > last
                    if new.any():
                        last = int(sequence[-1])
                        yield sequence[new], rows[new]

    def head(self) -> str:
        """The layout's JSON of the first file, without reading its rows; "" if the file ends before it."""
        if plain.is_plain(self.files[0], self.files[0]):
            return plain.layout_of(self.files)
        for path, batch in self._chunks(self.files[0], self.files[0]):
            self._take(self.files[0], path, batch)
            if self.text:
                break
        return self.text

    def _read(self, file: Path, held: Path) -> Iterator[tuple[Words, Words]]:
        """Yields the rows of a file as they are in it, also those that an earlier file had."""
        self._assembler = None
        if plain.is_plain(held, file):
            yield from self._plain(file, held)
            return
        for path, batch in self._chunks(file, held):
            self._take(file, path, batch)
            yield from self._made(_MUCH)
        yield from self._made(0)

    def _plain(self, file: Path, held: Path) -> Iterator[tuple[Words, Words]]:
        """Yields the rows of a file in the plain form."""
        good = len(plain.START)
        if self.layout is None and (text := plain.layout_of(self.files)):
            self._know(file, text)
        for kind, data in plain.records(held, file):
            good += plain.size_of(data)
            try:
                if kind is plain.Kind.LAYOUT:
                    self._know(file, data.decode())
                elif kind is plain.Kind.EVENTS:
                    self.events |= plain.events_of(data)
                elif kind is plain.Kind.END:
                    self.last = plain.last_of(data)
                else:
                    self._add(data)
                    self.last = None  # an end before them was that of a recorder that was started again
            except ValueError:
                self.damaged += 1
            yield from self._made(0)
        self.cut += max(held.stat().st_size - good, 0)

    def _made(self, most: int) -> list[tuple[Words, Words]]:
        """The rows read since the last call; those of columns once there are more than `most` bytes."""
        made, self._rows = self._rows, []
        if self._assembler is not None and self._assembler.bytes > most:
            made.append(self._assembler.take())
        return made

    def _held(self, stack: ExitStack) -> list[tuple[Path, Path]]:
        """Each file, and where it can be read even if its recorder merges and removes it meanwhile."""
        for _ in range(_LOOKS):
            found = []
            try:
                for file in self.files:
                    if file.exists() and not file.is_file():
                        raise RecordingError(str(file), "it is no regular file", "Give a .rrd file that srl wrote")
                    descriptor = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
                    stack.callback(os.close, descriptor)
                    found.append((file, Path(f"/proc/self/fd/{descriptor}")))
                return found
            except FileNotFoundError as error:
                gone = Path(str(error.filename))
                self.files = listed(gone.parent)
                if not self.files or not gone.parent.name.endswith(ENDING):
                    break
        raise RecordingError(str(gone), "the file has gone meanwhile", "Read the finished recording")

    def _chunks(self, file: Path, held: Path) -> Iterator[Chunk]:
        """Yields the chunks of a file's whole messages, those of the layout first."""
        try:
            size, good = held.stat().st_size, whole(held)
        except RecordingError as error:
            raise RecordingError(str(file), error.problem, error.remedy) from None
        self.cut += max(size - good, 0)
        held_back: list[Chunk] = []  # rows wait until the layout has been read
        known = False
        with windows(held, 0, good) as found:
            for window in found:
                for path, batch in self._decoded(window, held, file):
                    known = known or path == f"/__properties/{PROPERTY}"
                    held_back.append((path, batch))
                    if known:
                        held_back.sort(key=lambda item: item[0] != f"/__properties/{PROPERTY}")
                        yield from held_back
                        held_back.clear()

    def _decoded(self, window: Window, held: Path, file: Path) -> list[Chunk]:
        """The chunks of a window; without the messages that a power failure or the disk has spoilt, which are cut."""
        try:
            return _decoded(window.path, file, named=window.start == 0)
        except RuntimeError as error:
            reason = str(error).splitlines()[0]
        made: list[Chunk] = []
        with windows(held, window.start, window.end, 0) as found:
            for single in found:
                try:
                    made += _decoded(single.path, file, named=single.start == 0)
                except RuntimeError:
                    self.cut += single.end - single.start
        if not made and window.start == 0:
            problem = f"rerun can't read it: {reason}"
            raise RecordingError(str(file), problem, "It is damaged, or from another rerun")
        return made

    def _take(self, file: Path, path: str, batch: pa.RecordBatch) -> None:
        try:
            if path == f"/__properties/{PROPERTY}":
                self._take_layout(file, batch)
            elif path == ROWS:
                self._take_rows(batch)
            elif path in _ARCHETYPES:
                self._take_events(batch, _ARCHETYPES[path])
            elif self._assembler is not None:
                self._assembler.add(path, batch)
        except (ValueError, KeyError, AttributeError, TypeError):  # other columns, or of other types, than were written
            self.damaged += 1

    def _take_layout(self, file: Path, batch: pa.RecordBatch) -> None:
        if not {"format", "layout"} <= set(batch.schema.names):
            problem = "its layout isn't as srl writes it"
            raise RecordingError(str(file), problem, "Give the file that srl wrote, not a copy that rerun's tools made")
        version = column(batch, "format")[0]
        if version not in (COLUMNS_ONLY, FORMAT):
            problem = f"the recording's format is {version}, this srl reads {COLUMNS_ONLY} and {FORMAT}"
            raise RecordingError(str(file), problem, "Read it with the version of srl that wrote it")
        layout = self._know(file, column(batch, "layout")[0])
        if version == COLUMNS_ONLY:
            from srl.runtime.recording.columns import Assembler, Columns

            self._assembler = Assembler(Columns(layout))
        else:
            self._assembler = None

    def _know(self, file: Path, text: str) -> Layout:
        """Takes the layout of a file."""
        if self.text and text != self.text:
            raise RecordingError(str(file), "it belongs to another run than the files before", "Keep runs apart")
        if self.layout is None:
            self.text, self.layout = text, Layout.from_json(text, str(file))
        return self.layout

    def _take_rows(self, batch: pa.RecordBatch) -> None:
        if self.layout is None:
            raise ValueError("rows before their layout")
        blocks = batch.column(batch.schema.names.index(f"{BLOCK}:block"))
        for i in range(len(blocks)):
            try:
                self._add(blocks[i].values.to_numpy().tobytes())
            except ValueError:
                self.damaged += 1

    def _add(self, block: bytes) -> None:
        """Takes a block of rows. Raises ValueError: it doesn't prove itself, or is of other rows."""
        if self.layout is None:
            raise ValueError("rows before their layout")
        sequence, rows = unpack(block)
        if rows.shape[1] != len(self.layout.recorded_names) + self.layout.floats:
            raise ValueError("its rows are of another width")
        self._rows.append((sequence, self.layout.upgrade(rows)))

    def _take_events(self, batch: pa.RecordBatch, archetype: str) -> None:
        names = (f"{archetype}:sequence", f"{archetype}:time", "TextLog:text", "TextLog:level")
        words = {n: column(batch, n) for n in names}
        cycles = batch.column(batch.schema.names.index("cycle")).to_pylist()
        for number, time, text, level, cycle in zip(*words.values(), cycles, strict=True):
            self.events[number] = Event(time, _LEVELS[level], cycle, text)


def column(batch: pa.RecordBatch, name: str) -> list[Any]:
    """The values of a component that has one value in each row."""
    values: list[Any] = batch.column(batch.schema.names.index(name)).flatten().to_pylist()
    return values


def _decoded(stream: Path, shown: Path, named: bool) -> list[Chunk]:
    """The chunks of a stream of whole messages; `named`: it must be srl's. RuntimeError: rerun can't decode it."""
    import rerun as rr

    from srl.runtime.recording.sound import sound

    if not sound(stream):
        raise RuntimeError("its data is damaged")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a stream correctly has no manifest at its end
        reader = rr.chunk.RrdReader(stream)
        if named and not any(store.application_id == APPLICATION for store in reader.recordings()):
            problem = "no run of srl is recorded in it"
            raise RecordingError(str(shown), problem, "Give a .rrd file that srl wrote")
        chunks = list(reader.stream())
    return [(chunk.entity_path, chunk.to_record_batch()) for chunk in chunks]


def last_row(path: Path) -> int:
    """The number of the last row of a file, found from its end; 0 if it has none there."""
    from srl.runtime.recording.columns import ROW

    source, good, last = Source([path]), whole(path), 0
    with windows(path, max(good - _TAIL, 0), good) as found:
        for window in found:
            for entity, batch in source._decoded(window, path, path):
                if entity == ROWS:
                    last = max(last, *batch.column(batch.schema.names.index(ROW)).to_pylist())
    return last


def gaps(sequence: Words) -> list[tuple[int, int]]:
    """(first, last) of each gap in ascending sequence numbers from 1."""
    before = np.append(0, sequence[:-1])
    at = np.flatnonzero(sequence != before + 1)
    return [(int(before[i]) + 1, int(sequence[i]) - 1) for i in at]
