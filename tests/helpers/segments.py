"""Recordings in segments, without the recorder's process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from helpers.recording import make_rows
from srl.runtime.ipc.events import Event
from srl.runtime.ipc.layout import Layout
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.framing import HEADER, strip
from srl.runtime.recording.segments import Segments


def expected(layout: Layout, count: int) -> np.ndarray:
    return np.concatenate([make_rows(layout, min(100, count + 1 - at), at) for at in range(1, count + 1, 100)])


def make_segments(folder: Path, layout: Layout, count: int, batch: int = 250, events: Sequence[Event] = ()) -> bytes:
    """Segments as the recorder writes them, without its process. Returns with what each begins."""
    layout.save(folder.parent / "layout.json")
    stream = Stream((folder.parent / "layout.json").read_text())
    binary = stream.recording.binary_stream()
    stream.head()
    head = binary.read()
    prologue = head[:HEADER] + strip(head)
    segments = Segments(folder, prologue)
    rows = expected(layout, count)
    for at in range(0, count, batch):
        part = rows[at : at + batch]
        stream.pack(np.arange(at + 1, at + 1 + len(part)), part)
        if at == 0:
            stream.events(range(1, len(events) + 1), events)
        segments.write(strip(binary.read()))
    segments.close()
    return prologue
