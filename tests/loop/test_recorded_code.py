"""The code of a law in a file is in the recording: a replay runs that, and only if it is asked to."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from helpers.own_law import LAW, written
from helpers.run import call, refused

from srl.runtime.cli import main
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import encoded
from srl.runtime.ipc.layout import Layout
from srl.runtime.loop.replay import recorded_code, replay
from srl.runtime.recording.reader import Recording, read

OTHER = LAW.replace("self.config.gain *", "3.0 *")
RUN = ("--sim", "--fast", "--duration", "1", "--record", "run.rrd")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `run.rrd` of a profile that was elsewhere; its law was typed, and isn't there any more."""
    folder = tmp_path_factory.mktemp("recorded")
    written(folder / "there")
    (folder / "typed.py").write_text(OTHER)
    call(folder, "run", "there/own.yaml", *RUN, "--set", "controllers.0.use=typed.py:FollowTwice")
    (folder / "typed.py").unlink()
    written(folder / "there", "raise AssertionError('what is on the disk was run')")
    return folder


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return read(folder / "run.rrd")


def layout_with(recording: Recording, **changed: Any) -> Layout:
    layout = deepcopy(recording.layout)
    layout.meta |= changed
    return layout


@pytest.mark.slow
def test_the_recorded_text_is_replayed_wherever_the_file_is(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recording: Recording
) -> None:
    monkeypatch.chdir(folder)
    assert main(["replay", "run.rrd", "--run-code"]) == 0
    said = capsys.readouterr().out
    assert "controllers.0.use: the recorded code was run, sha256" in said
    assert "identical" in said
    x, y = recording.value("knob.angle"), recording.value("follow-twice.y")
    active = recording.int("state") == 2
    assert y[active][1:-1] == pytest.approx(3.0 * x[active][1:-1])


@pytest.mark.slow
def test_nothing_of_a_recording_is_run_unasked(folder: Path, recording: Recording) -> None:
    for options in ([], ["--json"]):
        found = refused("replay", str(folder / "run.rrd"), *options)
        assert "runs code that the recording holds: ./follow.py:Knob, typed.py:FollowTwice" in found
        assert "--show-code" in found
    assert "runs code" in refused("export", str(folder / "run.rrd"), "--bvh", str(folder / "x.bvh"))
    marked = layout_with(recording, files=encoded(dict.fromkeys(("./follow.py", "--set typed.py"), b"1 / 0")))
    with pytest.raises(RecordingError, match="runs code"):
        replay(marked, recording.rows, "run.rrd")
    with pytest.raises(RecordingError, match=r"the recorded code can't be run.*line 1: ZeroDivisionError"):
        replay(marked, recording.rows, "run.rrd", run_code=True)


@pytest.mark.slow
def test_the_code_can_be_read_before_it_is_run_and_obeys_no_terminal(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], recording: Recording
) -> None:
    monkeypatch.chdir(folder)
    assert main(["replay", "run.rrd", "--show-code"]) == 0
    assert OTHER in capsys.readouterr().out
    assert main(["replay", "run.rrd", "--show-code", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["code"]["controllers.0.use"] == OTHER
    hostile = encoded({"./follow.py": b"raise 1 # \x1b]0;x\x07 \xff", "--set typed.py": "\u202e".encode()})
    held = recorded_code(layout_with(recording, files=hostile), "run.rrd")
    monkeypatch.setattr("srl.runtime.cli.replay.recorded_code", lambda *_: held)
    assert main(["replay", "run.rrd", "--show-code"]) == 0
    said = capsys.readouterr().out
    assert "raise 1 # \\x1b]0;x\\x07 \\xff" in said
    assert "\\u202e" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["../../outside.py", "/etc/outside.py", "./follow.py", "~/outside.py"])
def test_a_recording_that_lacks_the_code_reads_none_from_the_disk(
    name: str, tmp_path: Path, recording: Recording
) -> None:
    profile = recording.layout.meta["profile"].replace("./follow.py:", f"{name}:")
    for where in (tmp_path.parent.parent / "outside.py", tmp_path / "follow.py"):
        if where.parent == tmp_path or not where.exists():
            where.write_text("raise AssertionError('what is on the disk was run')")
    label = str(tmp_path / "a" / "own.yaml")
    empty = layout_with(recording, profile=profile, files={}, label=label, overrides=[])
    with pytest.raises(RecordingError, match="wasn't kept with the run"):
        replay(empty, recording.rows, "run.rrd", run_code=True)
    with pytest.raises(RecordingError, match="wasn't kept with the run"):
        recorded_code(empty, "run.rrd")


@pytest.mark.slow
def test_code_that_was_changed_in_the_recording_is_found_by_its_hash(recording: Recording) -> None:
    files = deepcopy(recording.layout.meta["files"])
    files["./follow.py"]["content"] = encoded({"a": b"1 / 0"})["a"]["content"]
    with pytest.raises(RecordingError, match="is damaged"):
        replay(layout_with(recording, files=files), recording.rows, "run.rrd", run_code=True)


@pytest.mark.slow
def test_code_that_this_machine_cant_import_says_what_is_missing(recording: Recording) -> None:
    text = OTHER.replace("import numpy as np", "import nowhere_at_all").encode()
    files = encoded(dict.fromkeys(("./follow.py", "--set typed.py"), text))
    with pytest.raises(RecordingError, match=r"recorded code can't be run.*No module named 'nowhere_at_all'") as error:
        replay(layout_with(recording, files=files), recording.rows, "run.rrd", run_code=True)
    assert "Install what is missing" in error.value.remedy


@pytest.mark.slow
def test_what_a_recording_calls_its_code_obeys_no_terminal(
    recording: Recording, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    profile = recording.layout.meta["profile"].replace("./follow.py:Knob", '"\\e]0;x\\a.py:Knob"')
    named = Recording(**(vars(recording) | {"layout": layout_with(recording, profile=profile)}))
    monkeypatch.setattr("srl.runtime.recording.reader.read", lambda _: named)
    assert "runs code that the recording holds: \\x1b]0;x\\x07.py:Knob" in refused("replay", str(folder / "run.rrd"))
