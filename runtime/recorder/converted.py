"""A `.rrd` of a recording that is in segments, above all of one made on a machine without rerun."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.framing import HEADER, strip
from srl.runtime.recording.plain import ENDING, ended
from srl.runtime.recording.segments import claim, folder_of, listed
from srl.runtime.recording.source import Source, gaps


def convert(path: Path, target: Path) -> tuple[int, list[str]]:
    """Writes the `.rrd` of a folder of segments and reads it back. The segments stay as they are.

    Returns:
        The number of its rows, and what of the recording isn't in it, a line each.
    Raises:
        RecordingError: it is no such folder, or is still written; there is something at the target; what was written
            isn't what was read.
    """
    if not path.is_dir() or not listed(path):
        raise RecordingError(str(path), "it is no folder of segments", "Give FILE.rrd.segments")
    if target.exists():
        raise RecordingError(str(target), "there is something of this name", "Choose another name")
    if target.absolute().parent == path.absolute():
        raise RecordingError(str(target), "it would be among the segments", "Choose another folder")
    claimed = claim(path)
    try:
        return _convert(Source(listed(path)), target)
    finally:
        os.close(claimed)


def _convert(source: Source, target: Path) -> tuple[int, list[str]]:
    blocks = list(source.blocks())
    if source.layout is None or not blocks:
        raise RecordingError(str(source.files[0]), "no row of it can be read", "There is nothing to convert")
    sequence, rows = (np.concatenate([block[i] for block in blocks]) for i in (0, 1))
    events = dict(sorted(source.events.items()))
    stream = Stream(source.text)
    binary = stream.recording.binary_stream()
    stream.prologue(rows[0])
    head = binary.read()
    unfinished = folder_of(target).with_name(f".{target.name}.part")
    try:
        with unfinished.open("xb") as file:
            file.write(head[:HEADER] + strip(head))
            stream.rows(sequence, rows)
            stream.events(list(events), list(events.values()))
            file.write(strip(binary.read()))
            file.flush()
            os.fsync(file.fileno())
        copy = Source([unfinished])
        found = list(copy.blocks())
        same = [np.concatenate([block[i] for block in found]) for i in (0, 1)]
        if not np.array_equal(same[0], sequence) or not np.array_equal(same[1], rows) or copy.events != events:
            raise RecordingError(str(target), "what was written isn't what was read", "Keep the segments; report this")
        unfinished.rename(target)
    except FileExistsError:
        raise RecordingError(str(unfinished), "it is there already", "Remove it, if nothing writes it") from None
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise RecordingError(str(target), f"it can't be written: {error.strerror}", "Choose another place") from None
    except RecordingError:
        unfinished.unlink(missing_ok=True)
        raise
    return len(rows), _left_out(source, int(sequence[-1]), sum(b - a + 1 for a, b in gaps(sequence)))


def _left_out(source: Source, last: int, missing: int) -> list[str]:
    left_out = []
    if source.cut or source.damaged:
        left_out.append(f"{source.cut} bytes of the segments are damaged, and {source.damaged} blocks of rows")
    if missing:
        left_out.append(f"{missing} rows are missing")
    if source.last is not None and source.last > last:
        left_out.append(f"its last {source.last - last} rows are missing")
    if source.files[-1].suffix == ENDING and not ended(source.files):
        left_out.append("its recorder didn't finish it: more rows may have been made")
    return left_out
