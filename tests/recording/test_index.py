"""`srl recordings`: what is listed, how the index follows the files, and what is deleted."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers.recording import make_layout, make_rows
from helpers.segments import make_segments

from srl.runtime.cli import main
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import encoded
from srl.runtime.ipc.header import Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording import index
from srl.runtime.recording.summary import Summary, persons, summarize


def save(path: Path, person: str = "", cause: Cause = Cause.END, rows: int = 50, name: str = "made-up") -> Layout:
    """A recording that moves, stops by `cause` by the second device, and then is ended by a request."""
    layout = make_layout(extra=1)
    layout.meta |= {"name": name} | ({"person": person} if person else {})
    made = make_rows(layout, rows)

    def word(name: str, at: slice, value: int) -> None:
        made[at, layout.int_names.index(name)] = value

    word("state", slice(None), State.ACTIVE)
    word("cause", slice(None), Cause.NONE)
    word("state", slice(30, None), State.STOPPED)
    word("cause", slice(30, None), cause)
    word("fault_source", slice(30, None), 1)
    word("state", slice(45, None), State.ENDED)
    if cause is not Cause.END:
        word("cause", slice(45, None), Cause.END)
    stream = Stream(layout.text)
    stream.recording.save(path)
    stream.prologue(None)
    stream.rows(np.arange(1, rows + 1), made)
    stream.recording.disconnect()
    return layout


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    save(folder / "a.rrd", "P07")
    save(folder / "b.rrd", "P08", Cause.DEVICE_LOSS)
    (folder / "sub").mkdir()
    save(folder / "sub" / "c.rrd", "P07", name="other")
    return folder


@pytest.fixture
def folder(kept: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(kept, tmp_path / "data"))


def listed(folder: Path, *options: str, capsys: pytest.CaptureFixture[str]) -> dict[str, dict[str, object]]:
    assert main(["recordings", str(folder), "--json", *options]) == 0
    return {r["name"]: r for r in json.loads(capsys.readouterr().out)["recordings"]}


def test_a_recording_says_whose_it_is_and_how_it_stopped(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = listed(folder, capsys=capsys)
    assert found.keys() == {"a.rrd", "b.rrd", "sub/c.rrd"}
    b = found["b.rrd"]
    assert (b["persons"], b["profile"], b["rows"], b["seconds"]) == (["P08"], "made-up", 50, 0.049)
    assert (b["stop"], b["fault"], b["problem"]) == ("device loss finger", True, "")
    assert (found["a.rrd"]["stop"], found["a.rrd"]["fault"]) == ("end", False)
    assert listed(folder, "--person", "P07", capsys=capsys).keys() == {"a.rrd", "sub/c.rrd"}
    assert listed(folder, "--fault", capsys=capsys).keys() == {"b.rrd"}
    assert listed(folder, "--profile", "other", capsys=capsys).keys() == {"sub/c.rrd"}
    assert main(["recordings", str(folder)]) == 0
    text = capsys.readouterr().out
    assert "FAULT device loss finger" in text
    assert "2024-01-1" in text
    assert main(["recordings", str(folder), "--person", "P7"]) == 2
    assert "Did you mean 'P07'" in capsys.readouterr().err


def test_persons_are_those_of_the_run_of_the_calibration_and_of_the_files_in_it() -> None:
    layout = Layout()
    layout.meta = {"profile": "name: a\n", "files": {}}
    assert persons(layout) == ()
    files = encoded({"p.json": b'{"person": "P02"}', "mesh.bin": b"\xff\x00", "list.json": b"[1]"})
    layout.meta = {"person": "P01", "files": files, "profile": "controllers:\n  - {use: marks, person: P03}\n"}
    assert persons(layout) == ("P01", "P03", "P02")
    layout.meta = {"profile": "a: [", "files": {"x": {}}, "person": "P01"}
    assert persons(layout) == ("P01",)


def test_the_index_saves_reading_and_follows_the_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []

    def counted(path: Path) -> Summary:
        read.append(path.name)
        return summarize(path)

    monkeypatch.setattr(index, "summarize", counted)
    first = index.entries(folder)
    assert sorted(read) == ["a.rrd", "b.rrd", "c.rrd"]
    assert (folder / index.NAME).stat().st_mode & 0o077 == 0, "it has persons' ids"
    read.clear()
    assert index.entries(folder) == first
    assert read == []
    shutil.copy(folder / "a.rrd", folder / "new.rrd")
    (folder / "b.rrd").unlink()
    os.utime(folder / "a.rrd", ns=(1, 1))
    assert {e.name for e in index.entries(folder)} == {"a.rrd", "new.rrd", "sub/c.rrd"}
    assert sorted(read) == ["a.rrd", "new.rrd"]
    read.clear()
    index.entries(folder, rebuild=True)
    assert len(read) == 3


@pytest.mark.parametrize("damage", ["text", "empty", "torn", "version", "table", "summary"])
def test_a_damaged_index_is_made_anew(folder: Path, damage: str) -> None:
    first, path = index.entries(folder), folder / index.NAME
    if damage in ("text", "empty", "torn"):
        data = path.read_bytes()
        path.write_bytes({"text": b"no database" * 500, "empty": b"", "torn": data[: len(data) // 2]}[damage])
    else:
        connection = sqlite3.connect(path)
        orders = {
            "version": "PRAGMA user_version = 99",
            "table": "DROP TABLE recordings",
            "summary": "UPDATE recordings SET summary = '{}'",
        }
        connection.execute(orders[damage])
        connection.commit()
        connection.close()
    assert index.entries(folder) == first
    assert index.entries(folder) == first


def test_without_a_place_for_the_index_every_recording_is_read(folder: Path) -> None:
    (folder / index.NAME).mkdir()  # nobody may write here, not even root
    output: list[str] = []
    assert len(index.entries(folder, report=output.append)) == 3
    assert "every recording is read" in output[0]


def test_damaged_recordings_are_listed_with_what_is_wrong(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (folder / "a.rrd").read_bytes()
    (folder / "torn.rrd").write_bytes(whole[: -len(whole) // 10])
    (folder / "cut.rrd").write_bytes(whole[: len(whole) // 8])
    (folder / "text.rrd").write_text("no recording at all")
    (folder / "empty.rrd").touch()
    flipped = bytearray(whole)
    for at in range(len(whole) // 4, len(whole) // 2, 97):
        flipped[at] ^= 0xFF
    (folder / "flipped.rrd").write_bytes(flipped)
    make_segments(folder / "run.rrd.segments", make_layout(), 100)
    found = listed(folder, "--damaged", capsys=capsys)
    assert found.keys() == {"torn.rrd", "cut.rrd", "text.rrd", "empty.rrd", "flipped.rrd", "run.rrd.segments"}
    for name, reported in found.items():
        assert reported["problem"], name
        assert reported["remedy"], name
    assert "isn't a rerun recording" in str(found["text.rrd"]["problem"])
    assert "hasn't finished" in str(found["run.rrd.segments"]["problem"])
    assert found["run.rrd.segments"]["rows"] == 100
    # Nobody knows whose the unreadable ones are: who deletes a person's is told.
    assert main(["recordings", str(folder), "--person", "P07"]) == 0
    assert "text.rrd" in capsys.readouterr().err


def test_all_of_a_person_are_deleted_after_being_asked(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    order = ["recordings", str(folder), "--person", "P07", "--delete"]
    assert main(order) == 2
    assert "Add --yes" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    for answer, left in (("n", 3), ("", 3), ("y", 1)):
        monkeypatch.setattr("builtins.input", lambda _, answer=answer: answer)
        assert main(order) == 0
        assert len(index.entries(folder)) == left
    assert (folder / "b.rrd").exists()
    assert main(["recordings", str(folder), "--delete", "--yes"]) == 2, "it must be said which"
    assert main(["recordings", str(folder), "--name", "b.rrd", "--delete", "--yes"]) == 0
    assert index.entries(folder) == []
    connection = sqlite3.connect(folder / index.NAME)
    assert connection.execute("SELECT count(*) FROM recordings").fetchone() == (0,)
    connection.close()


def test_what_is_open_is_not_deleted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open(folder / "a.rrd", "rb"):
        assert main(["recordings", str(folder), "--name", "a.rrd", "--delete", "--yes"]) == 1
    assert f"process {os.getpid()} has it open" in capsys.readouterr().err
    assert (folder / "a.rrd").exists()


def test_a_persons_recordings_are_exported_and_opened(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    to = folder.parent / "out"
    order = ["recordings", str(folder), "--person", "P07", "--export"]
    assert main([*order, "parquet", "--to", str(to)]) == 0
    assert {str(p.relative_to(to)) for p in to.rglob("*.parquet")} == {"a.parquet", "sub/c.parquet"}
    assert main([*order, "bids", "--to", str(to / "bids")]) == 0
    assert (to / "bids" / "sub-P07").is_dir()
    capsys.readouterr()


def test_recordings_are_opened_in_rerun_where_there_is_a_display(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[list[str]] = []
    monkeypatch.setattr(subprocess, "call", lambda command, env: opened.append(command[1:]) or 0)
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    asked = ["recordings", str(folder), "--name", "a.rrd", "--open"]
    assert main(asked) == 0
    said = capsys.readouterr()
    assert f"rerun --bind 127.0.0.1 {folder / 'a.rrd'}" in said.out
    assert "there is no display here" in said.err
    assert opened == []
    monkeypatch.setenv("DISPLAY", ":0")
    assert main(asked) == 0
    assert opened == [["--bind", "127.0.0.1", str(folder / "a.rrd")]]


def test_a_figure_is_drawn_of_a_recording_after_the_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = folder / "a.png"
    assert main(["export", str(folder / "a.rrd"), "--figure", str(picture), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figure"] == str(picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["export", str(folder / "a.rrd"), "--figure", str(folder / "a.txt")]) == 2
    assert "--figure: 'a.txt' isn't named as a picture" in capsys.readouterr().err


def test_what_changed_since_it_was_listed_is_not_deleted(folder: Path) -> None:
    entry = next(e for e in index.entries(folder) if e.name == "a.rrd")
    (folder / "a.rrd").unlink()
    save(folder / "a.rrd", "P09")  # while somebody was asked
    with pytest.raises(RecordingError, match="changed since it was listed"):
        index.delete(entry)
    assert (folder / "a.rrd").exists()


def test_nothing_is_deleted_but_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    segments, elsewhere = tmp_path / "data" / "run.rrd.segments", tmp_path / "elsewhere.rrd.segments"
    segments.parent.mkdir()
    make_segments(segments, make_layout(), 100)
    make_segments(elsewhere, make_layout(), 100)
    (segments.parent / "link.rrd.segments").symlink_to(elsewhere)
    assert listed(segments.parent, capsys=capsys).keys() == {"run.rrd.segments"}
    part = segments.with_name("run.rrd.part")  # of a merge that was killed
    part.write_bytes(b"rows of a person")
    (segments / "notes.txt").write_text("what was said")
    order = ["recordings", str(segments.parent), "--name", "run.rrd.segments", "--delete", "--yes"]
    assert main(order) == 1
    assert "notes.txt" in capsys.readouterr().err
    assert {p.name for p in segments.iterdir()} == {"000001.rrd", "notes.txt"}
    (segments / "notes.txt").unlink()
    assert main(order) == 0
    assert not segments.exists()
    assert not part.exists(), "what is left of a person's recording goes with it"
    assert elsewhere.exists()


def test_two_recordings_are_not_exported_to_one_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_segments(folder / "a.rrd.segments", make_layout(), 100)
    assert main(["recordings", str(folder), "--export", "parquet", "--json"]) == 1
    out, err = capsys.readouterr()
    files = [file for reported in json.loads(out)["exported"] for file in reported["files"]]
    assert len(files) == len(set(files)) == 3
    assert "would be lost" in err


def test_an_export_never_takes_the_place_of_a_recording(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {name: (folder / name).read_bytes() for name in ("a.rrd", "b.rrd")}
    for form in ("film", "bvh", "stills", "tree", "bids"):
        for target in before:
            assert main(["export", str(folder / "a.rrd"), f"--{form}", str(folder / target)]) == 2
            assert "would be lost" in capsys.readouterr().err
    assert {name: (folder / name).read_bytes() for name in before} == before


def test_a_figure_that_cannot_be_drawn_is_refused_before_the_run(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "finger-jog", "--sim", "--figure", str(folder / "a.rrd")]) == 2
    assert "isn't named as a picture" in capsys.readouterr().err


def test_a_name_that_is_no_utf8_is_listed_and_deleted_like_others(
    kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in (b"\xff.rrd", "ä.rrd".encode(), b"b.rrd"):
        shutil.copy(kept / "b.rrd", tmp_path / os.fsdecode(name))
    (tmp_path / os.fsdecode(b"\xff.jpg")).touch()
    for _ in range(2):  # read, and from the index
        assert {entry.name for entry in index.entries(tmp_path)} == {"\\xff.rrd", "ä.rrd", "b.rrd"}
    assert main(["recordings", str(tmp_path), "--person", "P08", "--delete", "--yes"]) == 0
    assert "\\xff.rrd" in capsys.readouterr().out
    assert [path.suffix for path in tmp_path.iterdir() if path.suffix in (".rrd", ".jpg")] == []
