"""One rerun stream of a run: every file and viewer of the run gets the same data in the same order."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence

import numpy as np

os.environ.pop("RERUN", None)  # with RERUN=off the recorder would record nothing

import pyarrow as pa
import rerun as rr

from srl.runtime.ipc.events import Event
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.recorder import blueprint
from srl.runtime.recorder.scene import Scene
from srl.runtime.recording.blocks import MOST, kin, pack
from srl.runtime.recording.columns import ROW, ArrowBatch, Columns
from srl.runtime.recording.format import APPLICATION, BLOCK, EVENT, EVENTS, FORMAT, LEVELS, PROPERTY, ROWS


def recording_id(text: str) -> str:
    """The recording's id, the same for every segment of one run.

    It is a hash of the layout's text, which contains the run's clock offset.
    """
    return hashlib.sha256(text.encode()).hexdigest()[:32]


class Stream:
    """Converts rows and events to rerun's data model. The caller attaches a file or a viewer.

    Attributes:
        recording: what is sent.
    """

    def __init__(self, text: str) -> None:
        """`text` is the layout's JSON."""
        self._text = text
        self.layout = Layout.from_json(text)
        self._columns = Columns(self.layout)
        self._scene = Scene(self._columns)
        self._near = kin(self.layout)
        self._newest = np.zeros((1, self.layout.width), np.int64)
        self.recording = rr.RecordingStream(APPLICATION, recording_id=recording_id(text), send_properties=False)

    @property
    def problems(self) -> list[str]:
        """What couldn't be drawn as it was asked for, a line each; known after `prologue`."""
        return self._scene.robots.problems

    def head(self) -> None:
        """Sends what a reader needs: format and layout."""
        meta = self.layout.meta
        digest = str(meta.get("sha256", ""))
        self.recording.send_recording_name(str(meta.get("name", "srl")))
        self.recording.send_property(PROPERTY, rr.AnyValues(format=FORMAT, layout=self._text, profile_sha256=digest))

    def prologue(self, row: Words | None) -> None:
        """Sends the data at the head of every file: layout, profile, names, blueprint.

        `row` (width,), if there is one, decides where the 3D view looks.
        """
        self.head()
        meta = self.layout.meta
        profile, digest = str(meta.get("profile", "")), str(meta.get("sha256", ""))
        document = rr.TextDocument(f"```yaml\n{profile}\n```\nsha256 {digest}", media_type="text/markdown")
        rr.log("/profile", document, static=True, recording=self.recording, strict=True)
        self._scene.statics(self.recording)
        self.recording.send_blueprint(blueprint.make(self.layout, row))

    def rows(self, sequence: Words, rows: Words) -> None:
        """Sends rows (k, width) with their sequence numbers (k,) as a file holds them: packed, and drawn."""
        if len(rows):
            self.pack(sequence, rows)
            self.draw(sequence, rows)

    def draw(self, sequence: Words, rows: Words) -> None:
        """Sends what a file shows of rows (k, width), which must follow those of the last call."""
        if len(rows):
            self._columns.draw(self.recording, rows)
            self._scene.send_states(self.recording, rows)
            self._newest = rows
            self._scene.send(self.recording, self._scene.thin(rows))

    def pack(self, sequence: Words, rows: Words, quick: bool = False) -> None:
        """Sends rows packed, and nothing that is drawn of them. `quick`: they are packed again soon."""
        for at in range(0, len(rows), MOST):
            part = slice(at, at + MOST)
            data = np.frombuffer(pack(sequence[part], rows[part], self.layout.ints, self._near, quick), np.uint8)
            indexes = [rr.TimeColumn(ROW, sequence=sequence[part][-1:]), *self._columns.times(rows[part][-1:])]
            descriptor = rr.ComponentDescriptor("block").with_builtin_archetype(BLOCK)
            column = rr.ComponentColumn(descriptor, ArrowBatch(pa.array(data)), offsets=[0, len(data)])
            rr.send_columns(ROWS, indexes, [column], recording=self.recording, strict=True)
            self._newest = rows

    def events(self, sequence: Sequence[int], events: Sequence[Event]) -> None:
        """Sends events. Each appears at the time of its cycle's row, or of the newest row before it."""
        if not events:
            return
        cycles = self.layout.header(self._newest, "cycle")
        at = np.searchsorted(cycles, [n.cycle for n in events], side="right") - 1
        _, time = self._columns.times(self._newest[np.clip(at, 0, len(cycles) - 1)])
        exact = {
            "sequence": pa.array(np.asarray(sequence, np.int64)),
            "time": pa.array(np.asarray([n.time for n in events], np.int64)),
        }
        columns = [
            rr.ComponentColumn(rr.ComponentDescriptor(name).with_builtin_archetype(EVENT), ArrowBatch(array))
            for name, array in exact.items()
        ]
        columns += rr.TextLog.columns(text=[n.text for n in events], level=[LEVELS[n.level] for n in events])
        indexes = [rr.TimeColumn("cycle", sequence=[n.cycle for n in events]), time]
        rr.send_columns(EVENTS, indexes, columns, recording=self.recording, strict=True)
