"""Reads recordings: a .rrd file, a folder of segments (torn or not), or a crash's black box."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.contracts.field import Field
from srl.runtime.ipc.events import Event, EventReader
from srl.runtime.ipc.header import LINK_CONNECTED
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.ring import RingReader
from srl.runtime.recording.segments import folder_of, listed
from srl.runtime.recording.source import Source, gaps

NO_ROWS: Final = "Its run ended before the first row was written, or a copy of it was cut off there"


@dataclass
class Recording:
    """A recording in memory, with the rows as they were in the ring.

    Attributes:
        path: the file or folder it was read from.
        layout: the meaning of the words; `text`: its JSON.
        sequence: (k,) sequence numbers of the rows, ascending.
        rows: (k, width) int64 words.
        missing: (first, last) of each gap in the sequence numbers, which start at 1.
        events: events in their order.
        salvaged: number of bytes of torn tails that were cut off.
    """

    path: Path
    layout: Layout
    sequence: Words
    rows: Words
    missing: list[tuple[int, int]]
    events: list[Event]
    salvaged: int
    text: str = ""

    def int(self, name: str) -> Words:
        """The word `name` of every row, (k,)."""
        return self.layout.header(self.rows, self._known(name, self.layout.int_names))

    @property
    def time(self) -> NDArray[np.float64]:
        """s from the first row, of every row, (k,)."""
        now = self.int("now")
        return (now - now[0]) * 1e-9

    def _known(self, name: str, names: Collection[str]) -> str:
        """Raises RecordingError: it isn't among the names."""
        if name not in names:
            raise RecordingError(str(self.path), f"it has no '{name}'", nearest(name, names))
        return name

    def states(self, device: str) -> list[Field]:
        """The signals that a device gave; none for a device that doesn't exist or gives none."""
        fields = self.layout.fields.values() if device in self.layout.devices else ()
        return [f for f in fields if f.role == "state" and f.name.partition(".")[0] == device]

    def connected(self, device: str) -> NDArray[np.bool_]:
        """Whether a device was connected, (k,)."""
        return self.int(f"{device}.link") & LINK_CONNECTED > 0

    def value(self, name: str) -> NDArray[np.float64]:
        """The signal `name` of every row, (k, ...): a signal of shape (3,) gives (k, 3)."""
        return self.layout.value(self.rows, self._known(name, self.layout.fields))


def read(path: Path | str) -> Recording:
    """Reads all rows into memory.

    Args:
        path: of the file or the folder of segments.
    Raises:
        RecordingError: there is nothing at the path, it isn't a recording, it is of another version, or it has no
            rows.
    """
    path = Path(path)
    if path.is_dir():
        recording = _black_box(path) if (path / "rows.ring").exists() else _files(path, listed(path))
    elif path.exists():
        recording = _files(path, [path])
    elif folder_of(path).is_dir():
        raise RecordingError(str(path), "the recording wasn't finished", f"Read its segments: {folder_of(path)}")
    else:
        raise RecordingError(str(path), "there is no such file or folder", "Check the path")
    if not len(recording.rows):
        raise RecordingError(str(path), "no row of the recording is whole", NO_ROWS)
    return recording


def check_run(folder: Path, text: str) -> None:
    """Checks that the newest segment belongs to the run whose layout's JSON is `text`.

    Raises:
        RecordingError: it belongs to another run.
    """
    for file in reversed(listed(folder)):
        found = Source([file]).head()
        if found and found != text:
            raise RecordingError(str(folder), "the segments of another run are there", "Move them away")
        if found:
            return


def _files(path: Path, files: list[Path]) -> Recording:
    if not files:
        problem = "the folder holds neither segments nor a black box"
        raise RecordingError(str(path), problem, "Give a .rrd file, its .segments folder or a black box folder")
    source = Source(files)
    blocks = list(source.blocks())
    if source.layout is None:
        raise RecordingError(str(path), "the recording is empty", NO_ROWS)
    sequence = np.concatenate([s for s, _ in blocks]) if blocks else np.empty(0, np.int64)
    rows = np.concatenate([r for _, r in blocks]) if blocks else np.empty((0, source.layout.width), np.int64)
    events = [event for _, event in sorted(source.events.items(), key=lambda item: item[0])]
    missing = gaps(sequence)
    there = int(sequence[-1]) if len(sequence) else 0
    if source.last is not None and source.last > there:
        missing.append((there + 1, source.last))
    return Recording(path, source.layout, sequence, rows, missing, events, source.cut, source.text)


def _black_box(path: Path) -> Recording:
    """Reads the newest rows of the ring, as a crash left it."""
    layout = Layout.load(path / "layout.json")
    with RingReader(path / "rows.ring", width=len(layout.recorded_names) + layout.floats) as ring:
        numbers, blocks = [np.empty(0, np.int64)], [np.empty((0, layout.width), np.int64)]
        while len(rows := ring.take()):
            numbers.append(np.arange(ring.sequence - len(rows) + 1, ring.sequence + 1))
            blocks.append(layout.upgrade(rows))
    events: list[Event] = []
    written = [file for name in ("events.ring", "notes.ring") if (file := path / name).exists()]  # now, and in 0.1.0
    if written:
        reader = EventReader(written[0])
        events = reader.take()
        reader.close()
    sequence = np.concatenate(numbers)
    return Recording(path, layout, sequence, np.concatenate(blocks), gaps(sequence), events, 0)
