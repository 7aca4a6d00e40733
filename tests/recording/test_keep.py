"""What `record.keep` deletes of a folder, and what it never does: another's, what is open, what nobody can read."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from helpers.recording import make_layout, make_rows, make_run
from helpers.segments import make_segments
from helpers.small_disk import small_disk

from srl.runtime.cli import main
from srl.runtime.cli.options import PICTURES
from srl.runtime.export.formats import ENDINGS
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.recorder.process import Recorder
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording import keep
from srl.runtime.recording.index import MADE_OF, Entry
from srl.runtime.recording.keep import LEDGER, Keep, make_room
from srl.runtime.recording.segments import folder_of

DAY = 86400.0
Save = Callable[..., Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The bytes of a recording, by person."""
    found = {}
    for person in ("", "P07", "P08"):
        path = tmp_path_factory.mktemp("made") / "x.rrd"
        layout = make_layout(extra=1)
        layout.meta |= {"person": person} if person else {}
        stream = Stream(layout.text)
        stream.recording.save(path)
        stream.prologue(None)
        stream.rows(np.arange(1, 21), make_rows(layout, 20))
        stream.recording.disconnect()
        found[person] = path.read_bytes()
    return found


@pytest.fixture
def save(tmp_path: Path, made: dict[str, bytes]) -> Save:
    def save(name: str, days: float, person: str = "") -> Path:
        path = tmp_path / name
        path.write_bytes(made[person])
        os.utime(path, (time.time() - days * DAY,) * 2)
        return path

    return save


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keep, "clock_is_kept", lambda: True)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != LEDGER)


def ledger(folder: Path) -> list[str]:
    return [json.loads(line)["name"] for line in (folder / LEDGER).read_text().splitlines()]


def test_without_the_key_nothing_is_deleted(tmp_path: Path, save: Save) -> None:
    save("old.rrd", 9999)
    assert make_room(tmp_path, Keep.of(None), (), pytest.fail) == ""
    assert names(tmp_path) == ["old.rrd"]


def test_the_oldest_make_room_and_what_must_stay_stays(tmp_path: Path, save: Save) -> None:
    save("another.rrd", 9, "P08")
    save("protected.rrd", 8).chmod(0o440)
    opened = save("opened.rrd", 7)
    save("elsewhere", 6).rename(tmp_path / "notes.txt")
    (tmp_path / "torn.rrd").write_bytes(b"no recording of anybody")
    os.utime(tmp_path / "torn.rrd", (0, 0))
    (tmp_path / "sub").mkdir()
    inside = save("inside.rrd", 6).rename(tmp_path / "sub" / "inside.rrd")
    (tmp_path / "link.rrd").symlink_to(inside)
    make_segments(folder_of(tmp_path / "running.rrd"), make_layout(), 20)
    os.utime(folder_of(tmp_path / "running.rrd"), (0, 0))
    stays = names(tmp_path)
    size = save("1.rrd", 5).stat().st_size
    mine = save("2.rrd", 4, "P07").stat().st_size
    save("3.rrd", 3)
    full = keep._files(tmp_path)
    output: list[str] = []
    room = Keep(bytes=sum(file.size for file in full) - size - mine)
    with open(opened, "rb"):
        assert make_room(tmp_path, room, ("P07",), output.append) == ""
    assert set(names(tmp_path)) - set(stays) == {"3.rrd"}
    assert set(names(tmp_path)) >= set(stays)
    assert ledger(tmp_path) == ["opened.rrd", "opened.rrd", "1.rrd", "2.rrd"], "what stays is said, too"
    assert "opened.rrd stays" in output[0]
    assert "has it open" in output[0]
    assert len(output) == 3


def test_pictures_and_exports_go_with_their_recording_and_nothing_else_does(tmp_path: Path, save: Save) -> None:
    save("old.rrd", 31)
    for name in ("old.png", "old.yaml", "older.png", "old.svg", "old.jpg"):
        (tmp_path / name).write_bytes(b"... Software Matplotlib")
    (tmp_path / "old.parquet").write_bytes(b"PAR1" + bytes(40 << 20) + b"srl.layout {} PAR1")
    (tmp_path / "old.mcap").write_bytes(b"another program's")
    (tmp_path / "old.pdf").write_bytes(b"what the person answered after the trial")
    (tmp_path / "old.svg").chmod(0o440)
    (tmp_path / "old.gif").symlink_to(tmp_path / "older.png")
    (tmp_path / "old.c3d").write_bytes(b"what the cameras of the lab saw in the same trial")
    os.utime(tmp_path / "old.c3d", ns=((tmp_path / "old.rrd").stat().st_mtime_ns - 1,) * 2)
    output: list[str] = []
    make_room(tmp_path, Keep(days=30.0), (), output.append)
    stays = ["old.c3d", "old.gif", "old.mcap", "old.pdf", "old.svg", "old.yaml", "older.png"]
    assert names(tmp_path) == stays
    assert "old.rrd was deleted with old.png, old.jpg, old.parquet" in output[0]
    assert json.loads((tmp_path / LEDGER).read_text())["with"] == ["old.png", "old.jpg", "old.parquet"]


def test_every_picture_and_export_is_known_as_such() -> None:
    assert set(MADE_OF) >= {*PICTURES, *ENDINGS.values(), ".gif", ".bvh"}


def test_a_quota_that_others_fill_is_said_and_their_recordings_stay(tmp_path: Path, save: Save) -> None:
    save("another.rrd", 9, "P08")
    save("mine.rrd", 1, "P07")
    why = make_room(tmp_path, Keep(bytes=1.0), ("P07",), lambda text: None)
    assert "no more of them may be deleted" in why
    assert names(tmp_path) == ["another.rrd"]
    order = ["run", "sixth-finger", "--sim", "--duration", "1", "--set", "record.keep.gigabytes=1e-9"]
    assert main([*order, "--record", str(tmp_path / "new.rrd")]) == 2
    assert names(tmp_path) == ["another.rrd"]


def test_by_age_only_with_a_clock_that_is_kept_right(
    tmp_path: Path, save: Save, monkeypatch: pytest.MonkeyPatch
) -> None:
    save("old.rrd", 31)
    save("young.rrd", 29)
    save("tomorrow.rrd", -400)  # the clock was set back since
    output: list[str] = []
    monkeypatch.setattr(keep, "clock_is_kept", lambda: False)
    make_room(tmp_path, Keep(days=30.0), (), output.append)
    assert "clock" in output[0]
    assert len(names(tmp_path)) == 3
    monkeypatch.setattr(keep, "clock_is_kept", lambda: True)
    make_room(tmp_path, Keep(days=30.0), (), output.append)
    assert names(tmp_path) == ["tomorrow.rrd", "young.rrd"]


def test_no_deletion_goes_unrecorded(tmp_path: Path, save: Save, monkeypatch: pytest.MonkeyPatch) -> None:
    save("old.rrd", 31)
    room = Keep(days=30.0)
    (tmp_path / LEDGER).symlink_to(tmp_path / "somewhere")
    make_room(tmp_path, room, (), lambda text: None)
    assert (tmp_path / "old.rrd").exists()
    assert not (tmp_path / "somewhere").exists()
    (tmp_path / LEDGER).unlink()

    def killed(entry: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(keep, "delete", killed)
        with pytest.raises(KeyboardInterrupt):
            make_room(tmp_path, room, (), lambda text: None)
    make_room(tmp_path, room, (), lambda text: None)
    assert ledger(tmp_path) == ["old.rrd", "old.rrd"]
    assert names(tmp_path) == []


def test_a_deletion_is_written_down_on_the_disk_before_the_file_goes(
    tmp_path: Path, save: Save, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut may leave a line too many, never one too few."""
    old, done, sync, delete = save("old.rrd", 31), [], os.fsync, keep.delete

    def kept(descriptor: int) -> None:
        done.append(f"{Path(os.readlink(f'/proc/self/fd/{descriptor}')).name} kept")
        sync(descriptor)

    def gone(entry: Entry) -> None:
        done.append(f"{entry.name} gone")
        delete(entry)

    monkeypatch.setattr(os, "fsync", kept)
    monkeypatch.setattr(keep, "delete", gone)
    make_room(tmp_path, Keep(days=30.0), (), lambda text: None)
    assert done == [f"{LEDGER} kept", "old.rrd gone"]
    assert not old.exists()


def test_a_running_recorder_makes_room_and_never_of_its_own(
    tmp_path: Path, save: Save, capfd: pytest.CaptureFixture[str]
) -> None:
    layout = make_layout()
    layout.meta["record"]["keep"] = {"days": None, "gigabytes": 1e-9}
    layout.meta["person"] = "P07"
    run, ring, _ = make_run(tmp_path / "run", layout)
    (tmp_path / "data").mkdir()
    for name, person in (("mine.rrd", "P07"), ("another.rrd", "P08")):
        save(name, 3, person).rename(tmp_path / "data" / name)
    loop = ControlEnd(run.loop_socket)
    recorder = Recorder(run, tmp_path / "data" / "out.rrd")
    ring.append(make_rows(layout, 1)[0])
    recorder._looked = float("-inf")
    recorder._grow([])
    ring.finish()
    assert recorder.run() == 0
    assert names(tmp_path / "data") == ["another.rrd", "out.rrd"]
    output = capfd.readouterr().err
    assert "mine.rrd was deleted" in output
    assert "this run is recorded all the same" in output
    notes = [loop.take(), loop.take()]
    assert [note.content["ask"] for note in notes if note] == ["note", "note"]
    assert "mine.rrd was deleted" in notes[0].content["text"]
    loop.close()


def test_many_deletions_at_once_are_few_events_and_nothing_is_said_each_minute(
    tmp_path: Path, save: Save, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The loop takes five notes at once; the kernel keeps ten."""
    monkeypatch.setattr(keep, "clock_is_kept", lambda: False)
    layout = make_layout()
    layout.meta["record"]["keep"] = {"days": 1.0, "gigabytes": 1e-9}
    run, ring, _ = make_run(tmp_path / "run", layout)
    (tmp_path / "data").mkdir()
    for number in range(9):
        save(f"{number}.rrd", 30 - number).rename(tmp_path / "data" / f"{number}.rrd")
    loop = ControlEnd(run.loop_socket)
    recorder = Recorder(run, tmp_path / "data" / "out.rrd")
    ring.append(make_rows(layout, 1)[0])
    for _ in range(2):
        recorder._looked = float("-inf")
        recorder._grow([])
    ring.finish()
    assert recorder.run() == 0
    notes = []
    while (note := loop.take()) is not None:
        notes.append(note.content["text"])
    assert len(notes) == 5
    assert "clock" in notes[0]
    assert "0.rrd was deleted" in notes[1]
    assert notes[-1].startswith("and 6 more")
    output = capfd.readouterr().err
    assert output.count("was deleted") == 9
    assert output.count("clock") == 1
    loop.close()


def test_half_a_line_of_a_full_disk_spoils_no_other(tmp_path: Path, save: Save) -> None:
    save("old.rrd", 31)
    (tmp_path / LEDGER).write_text('{"at": "2026-01-01T00:00:00+00:00", "na')
    make_room(tmp_path, Keep(days=30.0), (), lambda text: None)
    assert json.loads((tmp_path / LEDGER).read_text().splitlines()[-1])["name"] == "old.rrd"


def test_on_a_disk_that_is_full_to_the_last_byte_the_oldest_make_room(tmp_path: Path, save: Save) -> None:
    with small_disk(tmp_path / "disk") as disk:
        save("disk/old.rrd", 31)
        save("disk/new.rrd", 1)
        assert make_room(disk, Keep(days=60.0), (), pytest.fail) == "", "nothing is old, so the next finds its room"
        with (disk / "others").open("wb", buffering=0) as others, suppress(OSError):
            while others.write(bytes(512)):
                pass
        assert os.statvfs(disk).f_bavail == 0
        output: list[str] = []
        make_room(disk, Keep(days=30.0), (), output.append)
        assert names(disk) == ["new.rrd", "others"]
        assert ledger(disk) == ["old.rrd"]
        assert "was deleted" in output[0]
