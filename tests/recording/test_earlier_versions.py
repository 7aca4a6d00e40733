"""Recordings of earlier versions, whose rows have fewer words, are read: what is missing is 0."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
from helpers.recording import make_layout, make_rows

from runtime.ipc.layout import _FIRST_CYCLE, _FIRST_DEVICE, Layout
from runtime.ipc.ring import RingWriter
from runtime.recording.columns import Assembler, Columns
from runtime.recording.reader import read


def _first() -> Layout:
    """A layout as the first version wrote it: it doesn't name its words."""
    layout = make_layout()
    layout.recorded = _FIRST_CYCLE, _FIRST_DEVICE
    return layout


def _text(layout: Layout, path: Path) -> str:
    layout.save(path)
    content = json.loads(path.read_text())
    del content["words"]
    path.write_text(json.dumps(content))
    return path.read_text()


def test_a_black_box_of_the_first_version(tmp_path: Path) -> None:
    layout = _first()
    rows = make_rows(layout, 50)
    _text(layout, tmp_path / "layout.json")
    then = layout.recorded_names
    kept = [layout.int_names.index(name) for name in then]
    written = np.concatenate([rows[:, kept], rows[:, layout.ints :]], axis=1)
    ring = RingWriter.create(tmp_path / "rows.ring", written.shape[1], 64)
    for row in written:
        ring.append(row)
    found = read(tmp_path)
    new = [i for i, name in enumerate(layout.int_names) if name not in then]
    assert len(new) >= len(layout.devices), "this version has words of its own"
    expected = rows.copy()
    expected[:, new] = 0
    assert found.rows.tobytes() == expected.tobytes()


def test_columns_of_the_first_version(tmp_path: Path) -> None:
    layout = Layout.from_json(_text(_first(), tmp_path / "layout.json"))
    rows, columns = make_rows(layout, 20), Columns(layout)
    assembler = Assembler(columns)
    absent = [name for name in layout.int_names if name not in layout.recorded_names]
    for path, found in columns.entities.items():
        there = [c for c in found if not (c.start < layout.ints and layout.int_names[c.start] in absent)]
        arrays = [pa.array(np.arange(1, 21))]
        for c in there:
            block = np.ascontiguousarray(rows[:, c.start : c.start + c.size]).view(c.kind)
            arrays.append(pa.FixedSizeListArray.from_arrays(pa.array(block.ravel()), c.size))
        names = ["row", *(c.descriptor.component for c in there)]
        assembler.add(path, pa.RecordBatch.from_arrays(arrays, names))
    sequence, made = assembler.take()
    expected = rows.copy()
    expected[:, [layout.int_names.index(name) for name in absent]] = 0
    assert sequence.tolist() == list(range(1, 21))
    assert made.tobytes() == expected.tobytes()


def test_a_layout_names_the_words_of_its_rows(tmp_path: Path) -> None:
    layout = make_layout()
    layout.save(tmp_path / "layout.json")
    again = Layout.load(tmp_path / "layout.json")
    assert again.recorded_names == again.int_names == layout.int_names
    rows = make_rows(layout, 3)
    assert again.upgrade(rows) is rows
