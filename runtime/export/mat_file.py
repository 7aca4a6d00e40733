"""A recording as a MATLAB file: `time`, `row`, and a struct a signal with its values, unit and labels.

A name that MATLAB doesn't take has `_` for each sign that it forbids: "finger.position" is `signals.finger_position`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime.export.report import Report, needed, whole_file
from srl.runtime.recording.reader import Recording

LONGEST: Final = 63  # characters of a name


def write(recording: Recording, target: Path) -> Report:
    """Writes `target`.

    Raises:
        RecordingError: it can't be written.
        HostError: the package isn't installed.
    """
    scipy_io = needed("scipy.io", "--mat")
    layout = recording.layout
    signals: dict[str, Any] = {}
    for field in layout.fields.values():
        if not field.size:
            continue
        values = recording.value(field.name).reshape(len(recording.rows), *(field.shape or (1,)))
        made: dict[str, Any] = {"name": field.name, "values": values, "unit": field.unit, "frame": field.frame or ""}
        if field.labels:
            made["labels"] = np.array(field.labels, dtype=object)
        signals[_name(field.name, signals)] = made
    header: dict[str, Any] = {}
    for name in layout.int_names:
        header[_name(name, header)] = recording.int(name)
    content = {
        "time": (recording.int("now") - recording.int("now")[0]) / 1e9,
        "row": np.asarray(recording.sequence),
        "signals": signals,
        "header": header,
        "events": np.array([event.text for event in recording.events], dtype=object),
        "profile": str(layout.meta.get("name", "")),
        "layout": layout.text,
    }
    with whole_file(target) as part, open(part, "wb") as file:
        scipy_io.savemat(file, content, long_field_names=True, do_compression=True, oned_as="column")
    return Report([target], f"{len(recording.rows)} rows of {len(signals)} signals")


def _name(name: str, taken: dict[str, Any]) -> str:
    """A name that MATLAB takes, and that isn't there yet."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    made = (plain if plain[:1].isalpha() else f"x{plain}")[:LONGEST]
    number = 1
    while made in taken:
        number += 1
        made = f"{made[: LONGEST - 4]}_{number}"
    return made
