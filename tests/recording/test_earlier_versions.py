"""Recordings of earlier versions, whose rows have fewer words, are read: what is missing is 0."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from helpers.recording import make_layout, make_rows
from ruamel.yaml import YAML

from srl.runtime.cli import main
from srl.runtime.ipc.layout import _FIRST_CYCLE, _FIRST_DEVICE, Layout
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.pictures.figure import draw
from srl.runtime.profile import profile
from srl.runtime.recording.columns import ArrowBatch, Assembler, Columns
from srl.runtime.recording.reader import read
from srl.testing import simulate


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


def test_a_file_of_format_1_whose_columns_hold_every_row(tmp_path: Path) -> None:
    layout = make_layout()
    layout.save(tmp_path / "layout.json")
    rows = make_rows(layout, 200)
    with rr.RecordingStream("srl", send_properties=False) as stream:
        stream.save(tmp_path / "run.rrd")
        text = (tmp_path / "layout.json").read_text()
        stream.send_property("srl", rr.AnyValues(format=1, layout=text, profile_sha256=""))
        for at in (0, 150):
            part = rows[at : at + 150]
            for path, columns in Columns(layout).entities.items():
                parts = [
                    rr.ComponentColumn(
                        c.descriptor,
                        ArrowBatch(pa.array(part[:, c.start : c.start + c.size].copy().view(c.kind).ravel())),
                        offsets=np.arange(0, len(part) * c.size + 1, c.size, dtype=np.int32),
                    )
                    for c in columns
                ]
                index = rr.TimeColumn("row", sequence=np.arange(at + 1, at + 1 + len(part)))
                rr.send_columns(path, [index], parts, recording=stream, strict=True)
    found = read(tmp_path / "run.rrd")
    assert found.rows.tobytes() == rows.tobytes()
    assert (found.missing, found.salvaged) == ([], 0)


def test_a_layout_names_the_words_of_its_rows(tmp_path: Path) -> None:
    layout = make_layout()
    layout.save(tmp_path / "layout.json")
    again = Layout.load(tmp_path / "layout.json")
    assert again.recorded_names == again.int_names == layout.int_names
    rows = make_rows(layout, 3)
    assert again.upgrade(rows) is rows


_SIM = """\
sim:
  world: augmented-hand
  wearer: {recording: null}
"""


def _augmented_hand(folder: Path) -> Layout:
    """A short run of sixth-finger as it was when its world was `augmented-hand`, as a black box."""
    text = profile.find("sixth-finger")[1]
    run = simulate(text, 0.3)
    old = re.sub(r"models:\n(  .*\n)+", "", re.sub(r"sim:\n(  .*\n)+", _SIM, text)).replace(
        '"world.finger_tip"', '"world.finger_tip[finger]"'
    )
    layout = Layout(devices=run.layout.devices, meta=run.layout.meta | {"profile": old, "limits": {}})
    layout.meta |= {"automatic": True, "latches": []}
    layout.meta["record"] = {
        "plots": [p.model_dump() for p in profile.Profile.model_validate(_plain(old)).record.plots]
    }
    for f in run.layout.fields.values():
        if f.name == "world.finger_tip":
            layout.add(f.name, "truth", (1, 3), "m", frame="hand", labels=("finger",), components=f.components or ())
        elif f.name == "world.finger_contact":
            layout.add("world.contact_force", "truth", (1,), "N", labels=("finger",))
        else:
            layout.add(f.name, f.role, f.shape, f.unit, frame=f.frame, labels=f.labels, visual=f.visual, links=f.links)
    layout.save(folder / "layout.json")
    ring = RingWriter.create(folder / "rows.ring", run.rows.shape[1], 64)
    run.rows[:, layout.int_names.index("cycle")] -= 1  # a recording begins at 0
    for row in run.rows:
        ring.append(row)
    return layout


def _plain(text: str) -> object:
    tree = YAML(typ="safe", pure=True).load(text)
    del tree["sim"]
    return tree


@pytest.mark.slow
def test_a_run_in_the_world_augmented_hand_is_read_drawn_and_played(tmp_path: Path) -> None:
    _augmented_hand(tmp_path)
    found = read(tmp_path)
    assert found.layout.value(found.rows, "world.finger_tip").shape == (30, 1, 3)
    draw(found, tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    text = f"""\
name: play
rate: 100
devices:
  glove: {{driver: replay, recording: {tmp_path}, device: glove, at_end: hold}}
controllers:
  - {{use: hand-kinematics, name: hand, in: {{angles: glove.position}}}}
sim: {{world: cell, parts: {{thing: {{part: box, size: [1, 1, 1]}}}}}}
"""
    again = simulate(text, 0.5)
    last = found.layout.value(found.rows, "glove.position")[-1]
    np.testing.assert_array_equal(again.value("glove.position")[-1], last)


def test_it_is_not_replayed_but_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _augmented_hand(tmp_path)
    assert main(["replay", str(tmp_path)]) == 2
    output = capsys.readouterr().err
    assert len(output.strip().splitlines()) == 1
    for words in (str(tmp_path), "sim.world", "'augmented-hand' is made of parts now", "Use srl-runtime"):
        assert words in output
