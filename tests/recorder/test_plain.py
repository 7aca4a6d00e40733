"""Recording where rerun isn't: the segments are the recording; another machine makes a `.rrd` of them."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT
from helpers.recording import make_layout, make_run, write_run
from helpers.run import environment
from helpers.segments import expected
from helpers.srl_twin import TwinProcess
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.cli import main
from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.child import FINAL
from srl.runtime.recorder import base
from srl.runtime.recorder.converted import convert
from srl.runtime.recorder.plain import PlainRecorder
from srl.runtime.recording import index, plain
from srl.runtime.recording.keep import Keep, make_room
from srl.runtime.recording.plain import START, Kind, record, records
from srl.runtime.recording.reader import read
from srl.runtime.recording.segments import claim, folder_of, listed
from srl.runtime.recording.summary import Summary, summarize

AT_ONCE = 1e9  # rows/s
HEAVY = ("rerun", "pyarrow", "matplotlib", "mujoco", "pinocchio", "scipy", "eigenpy", "daqp", "aiohttp", "PIL",
         "cryptography")  # fmt: skip
"""What is blocked below: everything that a machine which only runs devices hasn't got."""
WITHOUT = f"""
from importlib.machinery import PathFinder
found = PathFinder.find_spec
PathFinder.find_spec = staticmethod(
    lambda name, path=None, target=None: None if name.partition(".")[0] in {HEAVY} else found(name, path, target)
)
"""


def test_rows_and_events_come_back_bit_for_bit_and_a_torn_tail_is_cut(tmp_path: Path) -> None:
    layout = make_layout(extra=4)
    run, ring, events = make_run(tmp_path / "run", layout, capacity=4096)
    out = tmp_path / "out.rrd"
    write_run(run, ring, events, layout, 3000, AT_ONCE)
    ring.finish()
    assert PlainRecorder(run, out).run() == base.WELL
    folder = folder_of(out)
    assert not out.exists()
    found = read(folder)
    assert np.array_equal(found.rows, expected(layout, 3000))
    assert (found.missing, found.salvaged) == ([], 0)
    assert [n.text for n in found.events] == [f"row {i}: Grüße" for i in range(500, 3001, 500)]
    assert PlainRecorder(run, out).run() == base.WELL  # started again after its end
    last = listed(folder)[-1]
    whole = last.read_bytes()
    last.write_bytes(whole[:-3])
    assert 0 < read(folder).salvaged < len(whole)
    last.write_bytes(whole)
    main(["export", str(folder), "--rrd", str(out)])
    made = read(out)
    assert np.array_equal(made.rows, found.rows)
    assert made.events == found.events
    with pytest.raises(RecordingError, match="something of this name"):
        convert(folder, out)


def test_rows_that_were_overwritten_are_told(tmp_path: Path) -> None:
    layout = make_layout(extra=4)
    run, ring, events = make_run(tmp_path / "run", layout, capacity=256)
    write_run(run, ring, events, layout, 600, AT_ONCE)
    ring.finish()
    assert PlainRecorder(run, tmp_path / "out.rrd").run() == FINAL
    assert np.array_equal(read(tmp_path / "out.rrd.segments").rows, expected(layout, 600)[344:])


def test_a_file_of_another_version_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "a.rrd.segments"
    folder.mkdir()
    (folder / "000001.rows").write_bytes(START[:4] + b"\2\0\0\0")
    with pytest.raises(RecordingError, match="have the form 2, this srl reads 1"):
        read(folder)


@given(st.lists(st.tuples(st.sampled_from(list(Kind)), st.binary(max_size=40)), max_size=6), st.data())
def test_damage_costs_the_record_in_which_it_is_and_no_other(
    made: list[tuple[Kind, bytes]], data: st.DataObject
) -> None:
    content = bytearray(START + b"".join(record(kind, text) for kind, text in made))
    at = data.draw(st.integers(len(START), max(len(content) - 1, len(START))))
    ends = [len(START)]
    for kind, text in made:
        ends.append(ends[-1] + len(record(kind, text)))
    if at < len(content):
        content[at] ^= 1 << data.draw(st.integers(0, 7))
    file = os.memfd_create("test")
    try:
        os.write(file, content)
        path = Path(f"/proc/self/fd/{file}")
        found = list(records(path, path))
    finally:
        os.close(file)
    hurt = next((i for i, end in enumerate(ends[1:]) if at < end), len(made))
    assert found[:hurt] == made[:hurt]
    behind = made[hurt + 1 :]
    assert found[len(found) - len(behind) :] == behind


def damaged(folder: Path, place: int) -> None:
    file = listed(folder)[0]
    content = bytearray(file.read_bytes())
    content[place] ^= 1
    file.write_bytes(content)


def recorded(folder: Path, count: int = 9000) -> Path:
    """A finished recording of so many rows in the plain form."""
    layout = make_layout(extra=4)
    run, ring, events = make_run(folder / "run", layout, capacity=16384)  # so they come in several batches
    write_run(run, ring, events, layout, count, AT_ONCE)
    ring.finish()
    assert PlainRecorder(run, folder / "out.rrd").run() == base.WELL
    return folder_of(folder / "out.rrd")


def test_a_whole_one_is_told_from_one_that_isn_t(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recorded(tmp_path)
    assert summarize(folder).problem == ""
    assert plain.ended(listed(folder))
    last = listed(folder)[-1]
    content = last.read_bytes()
    last.write_bytes(content[: -len(plain.end_record(0))])  # at a record's edge
    assert "hasn't finished" in summarize(folder).problem
    main(["export", str(folder), "--rrd", str(tmp_path / "cut.rrd")])
    assert "not whole: its recorder didn't finish it" in capsys.readouterr().out
    last.write_bytes(content)
    damaged(folder, len(listed(folder)[0].read_bytes()) // 2)
    assert "damaged" in summarize(folder).problem
    main(["export", str(folder), "--parquet", str(tmp_path / "hurt.parquet")])
    main(["export", str(folder), "--rrd", str(tmp_path / "hurt.rrd")])
    assert "not whole: " in capsys.readouterr().out


@pytest.mark.parametrize("place", [0, 3, 9, 40])
def test_the_head_of_a_file_and_its_layout_may_be_lost(tmp_path: Path, place: int) -> None:
    folder = recorded(tmp_path)
    content = listed(folder)[0].read_bytes()
    _, layout = next(iter(records(listed(folder)[0], folder)))
    (folder / "000009.rows").write_bytes(START + record(Kind.LAYOUT, layout) + content[-len(plain.end_record(0)) :])
    damaged(folder, place)
    assert np.array_equal(read(folder).rows, expected(read(folder).layout, 9000))


def test_what_is_still_written_isn_t_converted(tmp_path: Path) -> None:
    folder = recorded(tmp_path)
    held = claim(folder)
    try:
        with pytest.raises(RecordingError, match="another run is being recorded there"):
            convert(folder, tmp_path / "a.rrd")
    finally:
        os.close(held)
    with pytest.raises(RecordingError, match="among the segments"):
        convert(folder, folder / "a.rrd")


def test_a_finished_one_is_deleted_by_retention(tmp_path: Path) -> None:
    folder = recorded(tmp_path)
    last = listed(folder)[-1]
    content = last.read_bytes()
    output: list[str] = []
    last.write_bytes(content[:-1])
    assert make_room(tmp_path, Keep.of({"gigabytes": 1e-9}), (), output.append) != ""
    assert folder.exists()  # unfinished
    last.write_bytes(content)
    assert make_room(tmp_path, Keep.of({"gigabytes": 1e-9}), (), output.append) == ""
    assert not folder.exists()
    assert "was deleted" in output[-1]


@pytest.mark.parametrize(
    "damage", [b"nonsense", b"[[1]]", b'[["a", 1, "INFO", 1, "x"]]', b'[[1, 1, "LOUD", 1, "x"]]', b"7", b"[" * 5000]
)
def test_events_that_are_none_are_refused(damage: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011  json's own words, or int's
        plain.events_of(damage)


def test_an_end_with_rows_behind_it_is_none(tmp_path: Path) -> None:
    folder = recorded(tmp_path)
    first, *others = records(listed(folder)[0], folder)
    end = others.pop()
    assert end[0] is Kind.END
    made = START + b"".join(record(*one) for one in (first, end, *others))  # the recorder went on, and was killed
    for file in listed(folder):
        file.unlink()
    (folder / "000001.rows").write_bytes(made)
    assert "hasn't finished" in summarize(folder).problem


def test_what_only_this_machine_can_t_read_isn_t_kept_as_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = recorded(tmp_path)

    def summary() -> Summary:
        return next(entry.summary for entry in index.entries(tmp_path) if entry.path == folder)

    def missing(_: Path) -> Summary:
        raise ModuleNotFoundError("No module named 'rerun'", name="rerun")

    with monkeypatch.context() as patch:
        patch.setattr(index, "summarize", missing)
        assert "rerun isn't installed" in summary().problem
        assert "srl-runtime[view]" in summary().remedy
    assert summary().problem == ""


def test_every_extra_that_is_named_has_the_library() -> None:
    """By the names under which they are installed, where these are others."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    installed = {"PIL": "pillow", "pinocchio": "pin", "rerun": "rerun-sdk", "example_robot_data": "example-robot-data"}
    for module, extra in extras.EXTRA_OF.items():
        packages = [re.split(r"[><=\[]", text)[0] for text in project["optional-dependencies"][extra]]
        assert installed.get(module, module) in packages, (module, extra)
    assert all(any(text.startswith(name) for text in project["dependencies"]) for name in extras.WHERE_A_WHEEL_IS)


def core(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`srl` in a process, and in those that it starts, without the libraries that only some machines have."""
    (folder / "sitecustomize.py").write_text(WITHOUT)
    variables = environment(folder)
    variables["PYTHONPATH"] = f"{folder}{os.pathsep}{variables.get('PYTHONPATH', '')}"
    return subprocess.run(
        [sys.executable, "-m", "srl", *arguments], cwd=folder, env=variables, capture_output=True, text=True,
        timeout=100, check=False,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.serial  # beside others its twin answers late
def test_a_machine_with_the_core_alone_runs_records_and_replays_a_device(tmp_path: Path) -> None:
    """`servo-jog`'s driver in front of its twin, which is in another process with everything installed."""
    with TwinProcess("servo-jog") as twin:
        done = core(tmp_path, *twin.run, "--duration", "2", "--record", "run.rrd", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.strip().splitlines()[-1])
    assert (found["recording"], found["recording_complete"]) == ("run.rrd.segments", True)
    assert found["cycles"] > 100
    replayed = core(tmp_path, "replay", "run.rrd.segments", "--json")
    assert replayed.returncode == 0, replayed.stderr
    assert json.loads(replayed.stdout)["identical"] is True
    listed_ = core(tmp_path, "recordings", "--json")
    assert listed_.returncode == 0, listed_.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (("run", "servo-jog", "--sim", "--duration", "1"), "sim"),
        (("check", "kairos-man"), "models"),
        (("check", "servo-jog", "--figure", "a.png"), "view"),
        (("run", "vicon-station", "--view"), "panel"),
        (("run", "vicon-station", "--figure", "a.png"), "view"),
        (("keys", "keys", "robot"), "panel"),
    ],
)
def test_what_is_missing_is_named_with_the_command_that_installs_it(
    tmp_path: Path, arguments: tuple[str, ...], extra: str
) -> None:
    done = core(tmp_path, *arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"pip install 'srl-runtime[{extra}]'" in done.stderr
    assert "Traceback" not in done.stderr
