"""The last rows of a run that didn't end well: saved at the next start, or moved aside, and never deleted."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from helpers.recording import make_layout, make_rows, make_run
from helpers.run import Running, call
from helpers.wait import until

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.ring import RingReader, RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.recording.reader import read
from srl.runtime.service.crash_dump import rescue, save


@pytest.fixture
def left(tmp_path: Path) -> tuple[RunFolder, RingWriter]:
    """What a run left that was killed after three rows."""
    layout = make_layout()
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in make_rows(layout, 3):
        ring.append(row)
    Launch("made-up", "name: made-up\n", recorded=True).save(run.launch)
    return run, ring


def boxes(folder: Path) -> list[Path]:
    return sorted(folder.glob("blackbox-*"))


def test_rows_that_nobody_saved_are_saved(left: tuple[RunFolder, RingWriter], tmp_path: Path) -> None:
    run, _ = left
    output: list[str] = []
    rescue(run, tmp_path / "state", output.append)
    (box,) = boxes(tmp_path / "state")
    assert np.array_equal(read(box).rows, make_rows(make_layout(), 3))
    assert output == [f"the run before didn't end properly; its last rows are in {box}"]
    assert {path.stat().st_mode & 0o777 for path in box.iterdir()} == {0o600}


def test_two_boxes_of_one_second_are_kept(tmp_path: Path) -> None:
    first, second = save(tmp_path, {"a": b"1"}), save(tmp_path, {"a": b"2"})
    assert (first / "a").read_bytes() == b"1"
    assert (second / "a").read_bytes() == b"2"


def test_rows_that_are_recorded_are_not(left: tuple[RunFolder, RingWriter], tmp_path: Path) -> None:
    run, ring = left
    ring.finish()
    with RingReader(run.rows, marks=True) as reader:
        reader.set_consumed(3)
    rescue(run, tmp_path / "state", pytest.fail)
    assert boxes(tmp_path / "state") == []


def test_rows_that_are_missing_in_the_recording_are_saved(left: tuple[RunFolder, RingWriter], tmp_path: Path) -> None:
    run, ring = left
    ring.finish()
    with RingReader(run.rows, marks=True) as reader:
        reader.set_consumed(1)
    output: list[str] = []
    rescue(run, tmp_path / "state", output.append)
    assert output[0].startswith("2 rows of the run before aren't in its recording")


@pytest.mark.parametrize("saved", [True, False])
def test_a_dead_loops_rows_are_saved_once(left: tuple[RunFolder, RingWriter], tmp_path: Path, saved: bool) -> None:
    run, _ = left
    with RingReader(run.rows, marks=True) as reader:
        reader.set_consumed(3)
        reader.finish(saved)
    rescue(run, tmp_path / "state", lambda text: None)
    assert len(boxes(tmp_path / "state")) == (not saved)


def test_a_state_folder_that_cant_be_written(left: tuple[RunFolder, RingWriter], tmp_path: Path) -> None:
    run, _ = left
    (tmp_path / "state").touch()
    output: list[str] = []
    rescue(run, tmp_path / "state", output.append)
    (box,) = boxes(run.path)
    assert len(read(box).rows) == 3
    assert not run.rows.exists()
    assert "can't be saved" in output[0]
    assert str(box) in output[0]


def test_what_can_neither_be_saved_nor_moved_stays_and_is_said(
    left: tuple[RunFolder, RingWriter], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, _ = left

    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(HostError, match=r"can't be moved aside: No space left"):
        rescue(run, tmp_path / "state", lambda text: None)
    assert run.rows.exists()


def test_a_damaged_ring_is_kept_as_it_is(left: tuple[RunFolder, RingWriter], tmp_path: Path) -> None:
    run, _ = left
    run.rows.write_bytes(b"half a ring")
    rescue(run, tmp_path / "state", lambda text: None)
    (box,) = boxes(tmp_path / "state")
    assert (box / "rows.ring").read_bytes() == b"half a ring"


@pytest.mark.slow
def test_the_next_start_saves_the_rows_of_a_run_that_was_killed_whole(tmp_path: Path) -> None:
    arguments = ("sixth-finger", "--sim", "--set", "bus=null")
    with Running(tmp_path, *arguments, "--duration", "60") as run:
        run.started()
        run.until(lambda: run.reader.head > 20, "some rows")
        reader, loop = run.reader, run.children()["loop"]
        run.process.send_signal(signal.SIGSTOP)  # so that it can't act
        os.kill(loop, signal.SIGKILL)
        run.process.kill()
        run.process.wait()
        until(lambda: not run.run_folder.is_claimed(), what="the end of all that it started")
    done = call(tmp_path, "run", *arguments, "--duration", "0.2")
    (box,) = boxes(tmp_path / "state" / "sixth-finger")
    assert f"the run before didn't end properly; its last rows are in {box}" in done.stderr
    assert len(read(box).rows) == reader.head
    done = call(tmp_path, "run", *arguments, "--duration", "0.2")
    assert "the run before" not in done.stderr
