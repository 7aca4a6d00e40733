"""A recording as Parquet: one row a cycle, a flat column for each word and each element of a signal.

Columns: `row` (the ring's sequence number), `time` (UTC, ns), the loop's and the devices' int64 words by name, each
element of each signal as float64, bit for bit. A column's metadata has `unit`, `signal`, `role` and `frame`.
The file's metadata has `srl.layout` (the whole layout, JSON), `srl.events` and `srl.missing`: nothing is left out.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from srl.runtime.export.report import Report, whole_file
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.elements import elements
from srl.runtime.recording.reader import Recording

ROWS = 1 << 16  # of a row group


def write(recording: Recording, target: Path) -> Report:
    """Writes `target`. Raises RecordingError: it can't be written."""
    layout = recording.layout
    names = _names(layout)
    schema = _schema(recording)
    wall = int(layout.meta.get("wall", 0))
    with whole_file(target) as part, pq.ParquetWriter(part, schema, compression="zstd", use_dictionary=False) as writer:
        for at in range(0, len(recording.rows), ROWS):
            rows = recording.rows[at : at + ROWS]
            times = (layout.header(rows, "now") + wall).astype("datetime64[ns]")
            columns = [pa.array(recording.sequence[at : at + ROWS]), pa.array(times).cast(schema.field("time").type)]
            for i in range(layout.width):
                words = np.ascontiguousarray(rows[:, i])
                columns.append(pa.array(words if i < layout.ints else words.view(np.float64)))
            writer.write_batch(pa.record_batch(columns, schema=schema))
    content = f"{len(recording.rows)} rows, {len(names) + 2} columns, one row a cycle"
    return Report([target], content)


def _names(layout: Layout) -> list[str]:
    return [*layout.int_names, *(e.name for f in layout.fields.values() for e in elements(f))]


def _schema(recording: Recording) -> pa.Schema:
    layout = recording.layout
    fields = [pa.field("row", pa.int64()), pa.field("time", pa.timestamp("ns", "UTC"))]
    fields += [pa.field(name, pa.int64()) for name in layout.int_names]
    for f in layout.fields.values():
        about = {"signal": f.name, "role": f.role} | ({"frame": f.frame} if f.frame else {})
        fields += [pa.field(e.name, pa.float64(), metadata=about | {"unit": e.unit}) for e in elements(f)]
    events = [{"time": e.time, "level": e.level.name, "cycle": e.cycle, "text": e.text} for e in recording.events]
    metadata = {
        "srl.layout": layout.text,
        "srl.events": json.dumps(events),
        "srl.missing": json.dumps(recording.missing),
    }
    return pa.schema(fields, metadata=metadata)
