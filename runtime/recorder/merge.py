"""Merges segments to one file. It is written beside the target, read back, compared, and only then put in place."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.contracts.errors import RecordingError
from runtime.ipc.layout import Words
from runtime.ipc.run_folder import free_bytes
from runtime.recorder.stream import Stream
from runtime.recording.segments import folder_of, listed
from runtime.recording.source import Source

BATCH = 4096  # rows in a chunk of the merged file


@dataclass
class Sum:
    """Number and checksum of rows: equal for two readings of the same rows."""

    rows: int = 0
    check: int = 0

    def add(self, sequence: Words, rows: Words) -> None:
        """Adds rows, in their order."""
        self.rows += len(rows)
        self.check = zlib.crc32(np.column_stack([sequence, rows]).tobytes(), self.check)


def merge(target: Path) -> int:
    """Merges the segments of `target` into it and removes them. Returns the number of rows.

    Raises:
        RecordingError: the merge failed; the text says why. The segments are kept as they are.
    """
    folder = folder_of(target)
    files = listed(folder)
    kept = f"The segments are kept and can be read as they are: {folder}"
    if target.exists():
        raise RecordingError(str(target), "a recording is there already", kept)
    if free_bytes(folder) < sum(f.stat().st_size for f in files):
        raise RecordingError(str(target), "the disk hasn't enough room for the merged recording", kept)
    part = target.with_name(f"{target.name}.part")
    part.unlink(missing_ok=True)
    try:
        source = Source(files)
        written = _write(source, part)
        copy = Source([part])
        found = Sum()
        for sequence, rows in copy.blocks():
            found.add(sequence, rows)
        if found != written or copy.events != source.events or copy.text != source.text or copy.cut:
            problem = f"the merged recording isn't complete ({found.rows} of {written.rows} rows)"
            raise RecordingError(str(target), problem, kept)
        part.rename(target)
    except OSError as error:
        raise RecordingError(str(target), f"it can't be written: {error.strerror}", kept) from None
    finally:
        part.unlink(missing_ok=True)
    remove(folder)
    return written.rows


def remove(folder: Path) -> None:
    """Removes the segments."""
    for file in listed(folder):
        file.unlink()
    folder.rmdir()


def covers(target: Path, rows: int) -> bool:
    """True if `target` is whole and ends with row `rows`: a merge was killed before it removed the segments."""
    source = Source([target])
    last = max((int(sequence[-1]) for sequence, _ in source.blocks()), default=0)
    return last == rows and source.cut == 0


def _write(source: Source, part: Path) -> Sum:
    written = Sum()
    stream: Stream | None = None
    sent: set[int] = set()
    for sequence, rows in _batches(source):
        if stream is None:
            stream = Stream(source.text)
            stream.recording.save(part)
            stream.prologue(rows[-1])
            stream.recording.flush()
        written.add(sequence, rows)
        stream.rows(sequence, rows)
        cycle = int(stream.layout.word(rows, "cycle")[-1])
        _events(stream, source, sent, cycle)
        stream.recording.flush()  # limits the data that waits in memory
    if stream is None:
        raise RecordingError(str(part.with_suffix("")), "no row was recorded", "The run ended before its first cycle")
    _events(stream, source, sent, None)
    stream.recording.flush()
    stream.recording.disconnect()  # writes the manifest and closes the file
    return written


def _events(stream: Stream, source: Source, sent: set[int], cycle: int | None) -> None:
    """Sends the events up to `cycle` that have not been sent yet."""
    new = sorted(n for n, event in source.events.items() if n not in sent and (cycle is None or event.cycle <= cycle))
    stream.events(new, [source.events[n] for n in new])
    sent.update(new)


def _batches(source: Source) -> Iterator[tuple[Words, Words]]:
    for sequence, rows in source.blocks():
        for at in range(0, len(rows), BATCH):
            yield sequence[at : at + BATCH], rows[at : at + BATCH]
