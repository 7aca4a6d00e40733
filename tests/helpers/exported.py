"""A made-up recording that exports are made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from helpers.recording import make_layout, make_rows
from srl.runtime.ipc.events import Event, Level
from srl.runtime.recording.elements import elements
from srl.runtime.recording.reader import Recording


def recorded(count: int = 600, without: slice = slice(0, 0)) -> Recording:
    """A made-up run with every kind of float64, an event and, if asked for, a gap."""
    layout = make_layout()
    layout.add("suit.markers", "state", (2, 3), "m", labels=("A", "B"), components=(("x", "y", "z"),), visual="points")
    layout.add("suit.marker_visible", "state", (2,), "1", labels=("A", "B"))
    rows, sequence = make_rows(layout, count), np.arange(1, count + 1)
    start = layout.ints + layout.fields["suit.markers"].offset
    rows[:, start : start + 6] = np.arange(count * 6.0).reshape(count, 6).view(np.int64)
    rows[:, start + 6 : start + 8] = np.where(np.arange(count)[:, None] % 7 == [0, 3], 0.0, 1.0).view(np.int64)
    kept = np.delete(np.arange(count), without)
    missing = [(int(without.start) + 1, int(without.stop))] if without.stop else []
    events = [Event(5, Level.WARNING, 100, "a finger\nwas lost: Grüße")]
    return Recording(Path("made-up.rrd"), layout, sequence[kept], rows[kept], missing, events, 0)


def columns(recording: Recording) -> dict[str, np.ndarray]:
    """Every number of a recording by its flat name."""
    layout = recording.layout
    found: dict[str, np.ndarray] = {name: recording.int(name) for name in layout.int_names}
    for field in layout.fields.values():
        flat = recording.value(field.name).reshape(len(recording.rows), -1)
        found |= {e.name: flat[:, i] for i, e in enumerate(elements(field))}
    return found


def same(ours: np.ndarray, theirs: Any) -> bool:
    """Bit for bit: NaN of every payload, too."""
    return np.ascontiguousarray(ours).tobytes() == np.ascontiguousarray(theirs).tobytes()
