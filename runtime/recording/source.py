"""Reads recorded rows file by file: cuts torn tails, drops duplicates, never holds more than one file in memory."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from runtime.contracts.errors import RecordingError
from runtime.ipc.events import Event
from runtime.ipc.layout import Layout, Words
from runtime.recording.columns import Assembler, Columns
from runtime.recording.format import APPLICATION, EVENT, EVENTS, FORMAT, LEVELS, OLD_EVENT, OLD_EVENTS, PROPERTY
from runtime.recording.framing import copy_prefix, whole

_MUCH = 64 << 20  # bytes of columns before rows are made of them
_ARCHETYPES = {EVENTS: EVENT, OLD_EVENTS: OLD_EVENT}
_LEVELS = {text: level for level, text in LEVELS.items()}
Chunk = tuple[str, pa.RecordBatch]


class Source:
    """A merged recording or segments, in their order.

    Attributes:
        text: the layout's JSON. Like `layout`, it is known once a block has been returned or all have been read.
        events: the events read so far, by sequence number.
        cut: number of bytes of torn tails in the files read so far.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = list(files)
        self.text = ""
        self.layout: Layout | None = None
        self.events: dict[int, Event] = {}
        self.cut = 0
        self._assembler: Assembler | None = None

    def blocks(self) -> Iterator[tuple[Words, Words]]:
        """Yields sequence numbers (k,), ascending throughout, and rows (k, width).

        Raises:
            RecordingError: a file isn't a recording of srl, or belongs to another version or run than the first.
        """
        last = 0
        for file in self.files:
            self._assembler = None
            for path, batch in self._chunks(file):
                self._take(file, path, batch)
                if self._assembler is not None and self._assembler.bytes > _MUCH:
                    sequence, rows = self._assembler.take()
                    new = sequence > last
                    if new.any():
                        last = int(sequence[-1])
                        yield sequence[new], rows[new]
            if self._assembler is not None:
                sequence, rows = self._assembler.take()
                new = sequence > last
                if new.any():
                    last = int(sequence[-1])
                    yield sequence[new], rows[new]

    def head(self) -> str:
        """The layout's JSON of the first file, without reading its rows; "" if the file ends before it."""
        for path, batch in self._chunks(self.files[0]):
            self._take(self.files[0], path, batch)
            if self.text:
                break
        return self.text

    def _chunks(self, file: Path) -> Iterator[Chunk]:
        """Yields the chunks of a file's whole messages, those of the layout first."""
        size, good = file.stat().st_size, whole(file)
        self.cut += size - good
        if good == 0:
            return
        if good == size:
            yield from _ordered(file, file)
            return
        with tempfile.TemporaryDirectory(prefix="srl-") as scratch:
            copy = Path(scratch) / file.name
            copy_prefix(file, copy, good)
            yield from _ordered(copy, file)

    def _take(self, file: Path, path: str, batch: pa.RecordBatch) -> None:
        if path == f"/__properties/{PROPERTY}":
            self._take_layout(file, batch)
        elif path in _ARCHETYPES:
            self._take_events(batch, _ARCHETYPES[path])
        elif self._assembler is not None:
            self._assembler.add(path, batch)

    def _take_layout(self, file: Path, batch: pa.RecordBatch) -> None:
        version = column(batch, "format")[0]
        if version != FORMAT:
            problem = f"the recording's format is {version}, this srl reads {FORMAT}"
            raise RecordingError(str(file), problem, "Read it with the version of srl that wrote it")
        text = column(batch, "layout")[0]
        if self.text and text != self.text:
            raise RecordingError(str(file), "it belongs to another run than the files before", "Keep runs apart")
        if not self.text:
            self.text, self.layout = text, Layout.from_json(text, str(file))
        assert self.layout is not None
        self._assembler = Assembler(Columns(self.layout))

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


def _ordered(file: Path, shown: Path) -> Iterator[Chunk]:
    """Yields the chunks of a file of whole messages. Rows are held back until the layout has been read."""
    held: list[Chunk] = []
    known = False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a segment correctly has no manifest at its end
            reader = rr.chunk.RrdReader(file)
            if not any(store.application_id == APPLICATION for store in reader.recordings()):
                raise RecordingError(str(shown), "no run of srl is recorded in it", "Give a .rrd file that srl wrote")
            stream = reader.stream()
        for chunk in stream:
            path, batch = chunk.entity_path, chunk.to_record_batch()
            known = known or path == f"/__properties/{PROPERTY}"
            held.append((path, batch))
            if known:
                held.sort(key=lambda item: item[0] != f"/__properties/{PROPERTY}")
                yield from held
                held.clear()
    except RuntimeError as error:  # rerun raises this for a file that it can't decode
        reason = str(error).splitlines()[0]
        raise RecordingError(
            str(shown), f"rerun can't read it: {reason}", "It is damaged, or from another rerun"
        ) from None


def gaps(sequence: Words) -> list[tuple[int, int]]:
    """(first, last) of each gap in ascending sequence numbers from 1."""
    before = np.append(0, sequence[:-1])
    at = np.flatnonzero(sequence != before + 1)
    return [(int(before[i]) + 1, int(sequence[i]) - 1) for i in at]
