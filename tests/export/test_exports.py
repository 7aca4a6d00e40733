"""Exports are read back by other libraries than the ones that wrote them, bit for bit where the format has the bits."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers.exported import columns, recorded, same
from helpers.run import call

from srl.runtime.cli.recordings import FORMATS as RECORDINGS_FORMATS
from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import RecordingError, RequestError
from srl.runtime.contracts.field import Field
from srl.runtime.export import formats, parquet_file, report
from srl.runtime.ipc.header import LINK_CONNECTED
from srl.runtime.ipc.layout import Layout
from srl.runtime.pictures.figure import draw
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.elements import elements
from srl.runtime.recording.index import made_of
from srl.runtime.recording.reader import Recording


def test_elements_are_called_as_plots_call_them_with_a_unit_each() -> None:
    def named(*shape: int, unit: str, **rest: Any) -> dict[str, str]:
        return {e.name: e.unit for e in elements(Field("a.b", "state", 0, shape, unit, **rest))}

    assert named(unit="1") == named(1, unit="1") == {"a.b": "1"}
    assert named(1, unit="N", labels=("grip",)) == {"a.b[grip]": "N"}
    assert named(2, 2, unit="m", labels=("p", "q"), components=(("x", "y"),)) == {
        "a.b[p,x]": "m", "a.b[p,y]": "m", "a.b[q,x]": "m", "a.b[q,y]": "m",
    }  # fmt: skip
    assert named(2, unit="m") == {"a.b[0]": "m", "a.b[1]": "m"}
    wrench = ("fx", "fy", "fz", "tx", "ty", "tz")
    assert list(named(6, unit="N, N m", labels=wrench).values()) == ["N"] * 3 + ["N m"] * 3
    assert list(named(6, unit="N, N m").values()) == ["N"] * 3 + ["N m"] * 3
    assert list(named(3, unit="m/s, rad/s", labels=("vx", "vy", "wz")).values()) == ["m/s", "m/s", "rad/s"]
    assert list(named(3, unit="m, rad", labels=("x", "y", "yaw")).values()) == ["m", "m", "rad"]
    assert list(named(4, unit="kg, m", labels=("mass", "x", "y", "z")).values()) == ["kg", "m", "m", "m"]
    assert list(named(2, 3, unit="m, N", labels=("hand", "force")).values()) == ["m"] * 3 + ["N"] * 3
    assert list(named(7, unit="m", labels=("x", "y", "z", "qw", "qx", "qy", "qz")).values()) == ["m"] * 3 + ["1"] * 4
    assert named(2, unit="rad/s", labels=("lift", "turn"), slides=("lift",)) == {
        "a.b[lift]": "m/s", "a.b[turn]": "rad/s",
    }  # fmt: skip


def test_a_joint_that_slides_keeps_its_unit_from_the_profile_on() -> None:
    layout = wiring.build(*profile.load("human-srl"), []).layout
    units = {e.parts[0]: e.unit for e in elements(layout.fields["arm.position_command"])}
    assert units == {"J1": "rad", "J2": "rad", "J3": "rad", "J4": "rad", "J5": "m", "J6": "rad", "J7": "rad"}


def test_parquet_has_every_number_in_pandas_and_polars(tmp_path: Path) -> None:
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    recording, target = recorded(without=slice(100, 140)), tmp_path / "run.parquet"
    made = formats.write("parquet", recording, target)
    assert made.left_out == []
    frame, table = pandas.read_parquet(target), polars.read_parquet(target)
    for name, values in columns(recording).items():
        assert same(values, frame[name].to_numpy()), name
        assert same(values, table[name].to_numpy()), name
    assert list(table["row"]) == recording.sequence.tolist()
    stamps = recording.int("now") + recording.layout.meta["wall"]
    assert frame["time"].astype("int64").tolist() == stamps.tolist()
    assert frame["time"].dt.tz is not None
    schema = pq.read_schema(target)
    assert schema.field("finger.position_command[mcp]").metadata == {
        b"signal": b"finger.position_command", b"role": b"command", b"unit": b"rad",
    }  # fmt: skip
    assert schema.field("hand.tips[thumb,0]").metadata[b"frame"] == b"hand"
    assert json.loads(schema.metadata[b"srl.layout"])["meta"] == recording.layout.meta
    assert json.loads(schema.metadata[b"srl.missing"]) == [[101, 140]]
    assert json.loads(schema.metadata[b"srl.events"])[0]["text"] == recording.events[0].text


def test_c3d_has_points_in_the_root_and_marks_what_was_not_measured(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    import c3d

    recording = recorded(without=slice(100, 140))
    recording.rows[:, recording.layout.int_names.index("glove.link")] = LINK_CONNECTED
    made = formats.write("c3d", recording, tmp_path / "run.c3d")
    assert any("odd.values" in line for line in made.left_out)
    assert any("event" in line for line in made.left_out)
    assert any("40 frames have no row" in line for line in made.left_out)
    with open(tmp_path / "run.c3d", "rb") as file:
        reader = c3d.Reader(file)
        names = [name.strip() for name in reader.point_labels]
        channels = [name.strip() for name in reader.analog_labels]
        frames = list(reader.read_frames())
        assert (reader.point_rate, reader.get("POINT:UNITS").string_value.strip()) == (1000.0, "mm")
    assert len(frames) == 600
    marker, thumb = names.index("suit.markers:A"), names.index("hand.tips:thumb")
    rows = {int(s) - 1: i for i, s in enumerate(recording.sequence)}
    for k, (_, points, analog) in enumerate(frames):
        measured = points[:, 3] >= 0
        if k not in rows:
            assert not measured.any()
            continue
        i = rows[k]
        visible = recording.value("suit.marker_visible")[i, 0] > 0
        assert measured[marker] == visible
        assert measured[thumb] == (k >= 99), "the frame's pose is known from the hundredth row on"
        if visible:
            assert np.allclose(points[marker, :3], 1000 * recording.value("suit.markers")[i, 0], rtol=1e-6)
        at = channels.index("glove.position[joint 3]")
        assert analog[at, 0] == np.float32(recording.value("glove.position")[i, 3])
    slow = formats.write("c3d", recording, tmp_path / "slow.c3d", rate=Fraction(100))
    assert slow.content.startswith("60 frames")


def test_c3d_says_what_it_cannot_hold(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    recording = recorded(10)
    recording.rows[-1, recording.layout.int_names.index("now")] += 70_000_000_000
    with pytest.raises(RecordingError, match=r"holds 65535.*--rate 9\d\d"):
        formats.write("c3d", recording, tmp_path / "run.c3d")
    for name in ("hand.tips", "suit.markers", "world.tip"):
        field = recording.layout.fields[name]
        recording.layout.fields[name] = Field(**{**vars(field), "visual": ""})
    with pytest.raises(RecordingError, match="no markers"):
        formats.write("c3d", recording, tmp_path / "run.c3d")
    assert list(tmp_path.iterdir()) == []


def test_bids_motion_follows_the_specification(tmp_path: Path) -> None:
    recording = recorded(300)
    recording.layout.add("glove.pose", "state", (7,), "m", frame="base", labels=("x", "y", "z", "qw", "qx", "qy", "qz"))
    recording = Recording(
        recording.path, recording.layout, recording.sequence, np.hstack([recording.rows, recording.rows[:, -7:]]), [],
        recording.events, 0,
    )  # fmt: skip
    start = recording.layout.ints + recording.layout.fields["glove.position"].offset
    recording.rows[5, start] = np.array(np.nan).view(np.int64)
    made = formats.write("bids", recording, tmp_path, person="P07")
    assert any("hand.tips" in line for line in made.left_out)
    stem = tmp_path / "sub-P07" / "motion" / "sub-P07_task-madeup_tracksys-glove_run-1"

    def table(path: Path) -> list[list[str]]:
        with open(path, newline="") as file:
            return list(csv.reader(file, delimiter="\t"))

    head, *channels = table(Path(f"{stem}_channels.tsv"))
    assert head[:5] == ["name", "component", "type", "tracked_point", "units"]
    motion = table(Path(f"{stem}_motion.tsv"))
    assert {len(row) for row in motion} == {len(channels)}, "no header, a column a channel"
    by_name = {channel[0]: dict(zip(head, channel, strict=True)) for channel in channels}
    assert by_name["glove.position[joint 3]"]["type"] == "JNTANG"
    assert by_name["glove.pose[qw]"] | {"name": ""} == {
        "name": "", "component": "quat_w", "type": "ORNT", "tracked_point": "glove", "units": "1",
        "reference_frame": "base",
    }  # fmt: skip
    assert (by_name["glove.pose[y]"]["type"], by_name["glove.pose[y]"]["component"]) == ("POS", "y")
    place = [channel[0] for channel in channels].index("glove.position[joint 0]")
    values = [row[place] for row in motion]
    assert values[5] == "n/a"
    true = recording.value("glove.position")[:, 0]
    assert [float(v) for i, v in enumerate(values) if i != 5] == [v for i, v in enumerate(true.tolist()) if i != 5]
    assert [float(row[0]) for row in motion] == ((recording.int("now") - recording.int("now")[0]) / 1e9).tolist()
    reported = json.loads(Path(f"{stem}_motion.json").read_text())
    assert (reported["SamplingFrequency"], reported["TaskName"], reported["JNTANGChannelCount"]) == (
        1000.0,
        "made-up",
        22,
    )
    types = [channel["type"] for channel in by_name.values()]
    counts = {key[: -len("ChannelCount")]: n for key, n in reported.items() if key.endswith("ChannelCount")}
    assert counts.pop("Motion") == len(channels)
    assert {kind: n for kind, n in counts.items() if n} == {kind: types.count(kind) for kind in set(types)}
    tracked = {c["tracked_point"] for c in by_name.values() if c["type"] not in ("MISC", "LATENCY")}
    assert reported["TrackedPointsCount"] == len(tracked)
    levels = json.loads(Path(f"{stem}_channels.json").read_text())["reference_frame"]["Levels"]
    assert "base" in levels
    formats.write("bids", recording, tmp_path, person="P07")
    formats.write("bids", recording, tmp_path, person="P08")
    assert [row[0] for row in table(tmp_path / "participants.tsv")] == ["participant_id", "sub-P07", "sub-P08"]
    scans = table(tmp_path / "sub-P07" / "sub-P07_scans.tsv")
    assert [row[0][-16:] for row in scans[1:]] == ["run-1_motion.tsv", "run-2_motion.tsv"]
    assert scans[1][1].startswith("2024-01-11T19:06:40.124456Z")
    with pytest.raises(RequestError, match="doesn't say whose it is"):
        formats.write("bids", recording, tmp_path)
    with pytest.raises(RecordingError, match="no BIDS label"):
        formats.write("bids", recording, tmp_path, person="../x")


@pytest.mark.slow
def test_the_bids_validator_has_nothing_to_say(tmp_path: Path) -> None:
    """The official one, of the data set's maintainers; what only a lab can say of its data set is there before."""
    call(tmp_path, "run", "ikns-finger", "--sim", "--fast", "--duration", "1", "--record", "run.rrd")
    own = {
        "Name": "reach", "BIDSVersion": "1.10.0", "DatasetType": "raw", "License": "CC0",
        "Authors": ["one", "another"], "HEDVersion": "8.3.0", "SourceDatasets": [{"URL": "https://example.org"}],
        "GeneratedBy": [{"Name": "srl-runtime"}],
    }  # fmt: skip
    for folder, before in (("whole", own), ("bare", None)):
        (tmp_path / folder).mkdir()
        if before is not None:
            (tmp_path / folder / "dataset_description.json").write_text(json.dumps(before))
        for _ in range(2):
            call(tmp_path, "export", "run.rrd", "--bids", folder, "--person", "P07")
        command = [Path(sys.executable).with_name("bids-validator-deno"), "--json", folder]
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        ended = subprocess.run(
            command, cwd=tmp_path, capture_output=True, check=False, env={**os.environ, "PATH": path}
        )
        issues = json.loads(ended.stdout)["issues"]["issues"]
        said = {(issue["code"], issue.get("subCode", "")) for issue in issues}
        left = {  # the lab's own to say
            ("JSON_KEY_RECOMMENDED", "HEDVersion"), ("JSON_KEY_RECOMMENDED", "License"),
            ("JSON_KEY_RECOMMENDED", "SourceDatasets"), ("NO_AUTHORS", "Authors"), ("TOO_FEW_AUTHORS", ""),
        }  # fmt: skip
        assert said == (set() if before is not None else left), issues


def test_bids_refuses_devices_whose_labels_are_one_and_takes_an_empty_list(tmp_path: Path) -> None:
    layout = Layout(devices=["arm-1", "arm1"])
    for device in layout.devices:
        layout.add(f"{device}.position", "state", (2,), "rad", labels=("a", "b"))
    rows = np.zeros((3, layout.width), np.int64)
    recording = Recording(Path("made-up.rrd"), layout, np.arange(1, 4), rows, [], [], 0)
    with pytest.raises(RecordingError, match="one would take the other's place"):
        formats.write("bids", recording, tmp_path, person="P07")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "participants.tsv").touch()
    formats.write("bids", recorded(10), tmp_path, person="P07")
    assert (tmp_path / "participants.tsv").read_text() == "participant_id\nsub-P07\n"


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.parquet").write_text("an older one")

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(parquet_file.pq.ParquetWriter, "write_batch", fail)
    with pytest.raises(RecordingError, match="No space left"):
        formats.write("parquet", recorded(10), tmp_path / "run.parquet")
    assert [p.name for p in tmp_path.iterdir()] == ["run.parquet"]
    assert (tmp_path / "run.parquet").read_text() == "an older one"


def test_a_package_that_is_not_installed_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(extras.EXTRA_OF, "mcap_writer_of_another_day", "mcap")
    with pytest.raises(Exception, match=r"pip install 'srl-runtime\[mcap\]'"):
        report.needed("mcap_writer_of_another_day", "--mcap")


@pytest.mark.slow
def test_mat_has_every_number_with_its_unit_and_names(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    recording = recorded(without=slice(100, 140))
    assert formats.write("mat", recording, tmp_path / "run.mat").left_out == []
    found = scipy_io.loadmat(tmp_path / "run.mat", simplify_cells=True)
    for field in recording.layout.fields.values():
        if field.size:
            made = found["signals"][field.name.replace(".", "_")]
            values = recording.value(field.name).reshape(len(recording.rows), *(field.shape or (1,)))
            assert same(values, np.asarray(made["values"]).reshape(values.shape)), field.name
            assert (made["name"], made["unit"]) == (field.name, field.unit)
            assert [*np.atleast_1d(made.get("labels", []))] == [*field.labels]
    assert same(recording.int("glove.stamp"), found["header"]["glove_stamp"])
    assert found["row"].tolist() == recording.sequence.tolist()
    assert Layout.from_json(found["layout"]).meta == recording.layout.meta


def cells_of(line: str) -> list[str]:
    """As OpenSim's FileAdapter takes a line apart: an empty cell at the end isn't one."""
    cells = line.split("\t")
    return cells if cells[-1] else cells[:-1]


def test_trc_has_the_points_of_c3d_with_y_up_as_opensim_reads_them(tmp_path: Path) -> None:
    pytest.importorskip("ezc3d")
    import c3d

    recording = recorded(without=slice(100, 140))
    formats.write("c3d", recording, tmp_path / "run.c3d")
    formats.write("trc", recording, tmp_path / "run.trc")
    lines = (tmp_path / "run.trc").read_text().splitlines()
    rate, _, frames, markers, unit = lines[2].split("\t")[:5]
    names = lines[3].split("\t")[2::3]
    assert (unit, int(markers), len(lines) - 6) == ("mm", len([n for n in names if n]), int(frames))
    with open(tmp_path / "run.c3d", "rb") as file:
        reader = c3d.Reader(file)
        assert float(rate) == pytest.approx(reader.point_rate)
        for line, (_, points, _) in zip(lines[6:], reader.read_frames(), strict=True):
            cells = cells_of(line)[2:]
            assert len(cells) == 3 * int(markers), "OpenSim refuses any other number, also where the last isn't seen"
            for i, point in enumerate(points):
                own = cells[3 * i : 3 * i + 3]
                if point[3] < 0:
                    assert own == ["", "", ""]
                else:
                    x, y, z = point[:3]  # forward, left, up
                    np.testing.assert_allclose([float(cell) for cell in own], [x, z, -y], rtol=1e-6, atol=1e-3)


def test_mot_has_the_joints_in_degrees(tmp_path: Path) -> None:
    recording = recorded()
    formats.write("mot", recording, tmp_path / "run.mot")
    text = (tmp_path / "run.mot").read_text()
    head, _, body = text.partition("endheader\n")
    assert "inDegrees=yes" in head
    columns_of, *rows = [line.split("\t") for line in body.splitlines()]
    assert f"nRows={len(rows)}" in head
    assert f"nColumns={len(columns_of)}" in head
    assert len(set(columns_of)) == len(columns_of)
    table = np.array(rows, float)
    glove = recording.layout.fields["glove.position"]
    at = columns_of.index(glove.labels[0].replace(" ", "_"))
    expected = np.degrees(recording.value("glove.position")[:, 0])
    np.testing.assert_allclose(table[:, at], expected, rtol=1e-6)


def test_exports_and_pictures_are_known_as_made_of_their_recording(tmp_path: Path) -> None:
    (tmp_path / "run.rrd").touch()
    wanted = [f"run{ending}" for ending in (".png", ".pdf", ".svg", ".eps")]
    for name in wanted:
        draw(recorded(), tmp_path / name)
    for form, ending in formats.ENDINGS.items():
        formats.write(form, recorded(), tmp_path / f"run{ending}")
        wanted.append(f"run{ending}")
    assert [path.name for path in made_of(tmp_path / "run.rrd")] == wanted
    assert RECORDINGS_FORMATS == formats.FORMATS  # `srl recordings --export` takes the same ones
