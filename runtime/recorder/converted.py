"""A `.rrd` of a recording that has none: of segments, above all those of a machine without rerun."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.framing import HEADER, strip
from srl.runtime.recording.reader import read


def convert(path: Path, target: Path) -> int:
    """Writes the `.rrd` and reads it back. Returns its number of rows; the given recording stays as it is.

    Raises:
        RecordingError: it can't be read whole; there is something at the target; what was written isn't the same.
    """
    if target.exists():
        raise RecordingError(str(target), "there is something of this name", "Choose another name")
    recording = read(path)
    stream = Stream(recording.text)
    binary = stream.recording.binary_stream()
    stream.prologue(recording.rows[0])
    head = binary.read()
    unfinished = target.with_name(f"{target.name}.part")
    try:
        with unfinished.open("wb") as file:
            file.write(head[:HEADER] + strip(head))
            stream.rows(recording.sequence, recording.rows)
            stream.events(range(1, len(recording.events) + 1), recording.events)
            file.write(strip(binary.read()))
            file.flush()
            os.fsync(file.fileno())
        copy = read(unfinished)
        if not np.array_equal(copy.rows, recording.rows) or copy.events != recording.events:
            raise RecordingError(str(target), "what was written isn't what was read", "Keep the segments; report this")
        unfinished.rename(target)
    except OSError as error:
        raise RecordingError(str(target), f"it can't be written: {error.strerror}", "Choose another place") from None
    finally:
        unfinished.unlink(missing_ok=True)
    return len(recording.rows)
