"""A recording that isn't whole is never said to be, however often the recorder is started to finish it."""

from __future__ import annotations

import os
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from helpers.recording import make_layout, make_run, write_run
from helpers.run import Running
from helpers.segments import expected
from helpers.wait import until

from srl.runtime.recorder import base
from srl.runtime.recorder.process import Recorder
from srl.runtime.recording import segments
from srl.runtime.recording.reader import read
from srl.runtime.recording.segments import folder_of, numbered
from srl.runtime.service.helpers import ATTEMPTS

AT_ONCE = 1e9  # rows/s


@pytest.fixture
def output(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the recorders say."""
    lines: list[str] = []
    monkeypatch.setattr(base, "say", lines.append)
    return lines


def test_rows_that_were_lost_stay_lost_when_the_recorder_is_started_again(tmp_path: Path, output: list[str]) -> None:
    layout = make_layout(extra=4)
    run, ring, events = make_run(tmp_path / "run", layout, capacity=256)
    out = tmp_path / "out.rrd"
    write_run(run, ring, events, layout, 600, AT_ONCE)  # the first 344 are overwritten before anybody reads them
    ring.finish()
    codes = [Recorder(run, out).run() for _ in range(ATTEMPTS)]
    assert np.array_equal(read(out).rows, expected(layout, 600)[344:])
    assert codes == [base.FINAL] * ATTEMPTS
    assert any("344" in line for line in output)


def test_a_recording_without_a_gap_is_still_complete_when_the_recorder_is_started_again(tmp_path: Path) -> None:
    layout = make_layout(extra=4)
    run, ring, events = make_run(tmp_path / "run", layout)
    write_run(run, ring, events, layout, 600, AT_ONCE)
    ring.finish()
    assert [Recorder(run, tmp_path / "out.rrd").run() for _ in range(2)] == [base.WELL] * 2


@pytest.mark.parametrize("deleted", ["folder", "files", "moved", "oldest"])
@pytest.mark.parametrize("merged", [False, True])
def test_what_is_deleted_during_the_run_is_written_again(
    tmp_path: Path, output: list[str], monkeypatch: pytest.MonkeyPatch, deleted: str, merged: bool
) -> None:
    monkeypatch.setattr(base, "RETRY", 0.01)
    monkeypatch.setattr(segments, "FIRST", 0.0)  # each batch is a segment of its own
    monkeypatch.setattr(segments, "SECONDS", 0.0 if merged else 1e9)
    layout = make_layout(extra=4)
    run, ring, events = make_run(tmp_path / "run", layout, capacity=1024)
    out = tmp_path / "out.rrd"
    folder = folder_of(out)
    with ThreadPoolExecutor(1) as thread:
        recorder = thread.submit(Recorder(run, out).run)
        try:
            for at in range(0, 700, 100):
                write_run(run, ring, events, layout, 100, AT_ONCE, first=at + 1)
                until(lambda at=at: ring.consumed == at + 100)
            if merged:
                until((folder / segments.GROWING).exists)
            if deleted == "folder":
                shutil.rmtree(folder, ignore_errors=True)
            elif deleted == "oldest":
                for file in numbered(folder)[:1]:
                    file.unlink(missing_ok=True)
            elif deleted == "files":
                for file in folder.glob("*.rrd"):
                    file.unlink(missing_ok=True)
            else:
                folder.rename(tmp_path / "elsewhere")
            write_run(run, ring, events, layout, 700, AT_ONCE, first=701)
            until(lambda: ring.consumed == 1400)
        finally:
            ring.finish()
        code = recorder.result(60)
    assert np.array_equal(read(out).rows, expected(layout, 1400))
    assert code == base.WELL
    assert not folder.exists()


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_appears_where_the_recording_is_to_be_is_left_alone_and_named(
    tmp_path: Path, kind: str, output: list[str]
) -> None:
    layout = make_layout(extra=4)
    run, ring, events = make_run(tmp_path / "run", layout)
    out = tmp_path / "out.rrd"
    recorder = Recorder(run, out)
    write_run(run, ring, events, layout, 600, AT_ONCE)
    ring.finish()
    if kind == "file":
        out.write_text("precious")
    else:
        out.mkdir()
    codes = [recorder.run(), *(Recorder(run, out).run() for _ in range(ATTEMPTS))]
    assert codes == [base.FINAL] * (1 + ATTEMPTS)
    assert out.is_dir() if kind == "folder" else out.read_text() == "precious"
    assert str(out) in output[-1]
    kept = read(folder_of(out))
    assert np.array_equal(kept.rows, expected(layout, 600))
    assert [event.text for event in kept.events] == ["row 500: Grüße"]
    out.rmdir() if kind == "folder" else out.unlink()
    assert Recorder(run, out).run() == base.WELL  # its place is free again
    assert np.array_equal(read(out).rows, expected(layout, 600))
    assert not numbered(folder_of(out))


@pytest.mark.slow
def test_a_loop_that_is_killed_before_its_first_row_has_no_complete_recording(tmp_path: Path) -> None:
    out = tmp_path / "run.rrd"
    with Running(tmp_path, "sixth-finger", "--sim", "--record", str(out), "--duration", "30") as run:
        run.until(lambda: "loop" in run.children(), "the loop's process")
        os.kill(run.children()["loop"], signal.SIGKILL)
        found = run.finish(code=1)
    assert not out.exists()
    assert found["recording_complete"] is False
    assert "recording" in run.stderr
