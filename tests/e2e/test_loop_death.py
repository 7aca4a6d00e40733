"""The loop's death with a board on a real pty: its stop arrives, whatever else has gone."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.firmata import ScriptedBoard
from helpers.run import Running, alive, environment
from helpers.wait import until

from srl.runtime.ipc.header import State
from srl.runtime.recording.reader import read

pytestmark = pytest.mark.slow

SERVOS = 4
ROOT = Path(__file__).parents[2]


@pytest.fixture
def board(tmp_path: Path) -> Iterator[ScriptedBoard]:
    with ScriptedBoard(tmp_path) as found:
        yield found


@pytest.fixture
def run(tmp_path: Path, board: ScriptedBoard) -> Iterator[Running]:
    """A finger that holds its home; the board has heard that."""
    arguments = ("finger-jog", "--confirm", "--set", f"devices.finger.port={board.port}")
    with Running(tmp_path, *arguments, instance="finger-jog") as running:
        running.started()
        running.until(lambda: running.header("state") == State.ACTIVE, "motion")
        running.until(lambda: pulses(board, 0) >= SERVOS, "the first pulses")
        yield running


def pulses(board: ScriptedBoard, since: int) -> int:
    """Number of servo commands heard."""
    return sum(message[0] & 0xF0 == 0xE0 for message in board.seen[since:])


def stopped(run: Running, board: ScriptedBoard, since: int) -> Path:
    """Waits for the end: each servo has its stop (a command again), and there is a black box."""
    found = run.finish(code=1)
    assert "Traceback" not in run.stderr
    until(lambda: pulses(board, since) >= SERVOS)
    assert "SIGKILL" in found["death"]["how"]
    return Path(found["death"]["black_box"])


def test_the_run_folder_is_gone(run: Running, board: ScriptedBoard) -> None:
    head, loop, mark = run.reader.head, run.children()["loop"], len(board.seen)
    shutil.rmtree(run.run_folder.path)
    os.kill(loop, signal.SIGKILL)
    assert len(read(stopped(run, board, mark)).rows) >= head


def test_a_run_whose_folder_is_gone_still_ends_well(run: Running) -> None:
    shutil.rmtree(run.run_folder.path)
    run.process.send_signal(signal.SIGTERM)
    found = run.finish(code=0)
    assert "Traceback" not in run.stderr
    assert "figures can't be kept" in run.stderr
    assert found["cause"] == "request"
    assert "death" not in found


def test_the_supervisor_has_no_descriptor_left(run: Running, board: ScriptedBoard) -> None:
    head, loop, mark = run.reader.head, run.children()["loop"], len(board.seen)
    used = max(int(name) for name in os.listdir(f"/proc/{run.process.pid}/fd")) + 1
    resource.prlimit(run.process.pid, resource.RLIMIT_NOFILE, (used, used))
    os.kill(loop, signal.SIGKILL)
    assert len(read(stopped(run, board, mark)).rows) >= head


def test_the_state_folder_cant_be_written(run: Running, board: ScriptedBoard, tmp_path: Path) -> None:
    loop, mark = run.children()["loop"], len(board.seen)
    shutil.rmtree(tmp_path / "state")
    (tmp_path / "state").touch()
    os.kill(loop, signal.SIGKILL)
    found = run.finish(code=1)
    until(lambda: pulses(board, mark) >= SERVOS)
    assert found["death"]["black_box"] is None
    assert "the black box can't be saved" in run.stderr


def test_only_the_owner_reads_the_files_of_a_run(run: Running) -> None:
    modes = {p.name: oct(p.stat().st_mode & 0o777) for p in run.run_folder.path.iterdir() if p.is_file()}
    assert modes.pop("lock") == "0o640"  # whoever may send requests asks it whether the instance runs
    assert set(modes.values()) == {"0o600"}, modes


def test_a_recorder_outlives_a_supervisor_that_dies_while_it_starts(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--set", "bus=null", "--record", "x.rrd") as run:
        run.until(lambda: "recorder" in run.children(), "the recorder's first instruction")
        children = run.children()
        run.process.kill()
        run.process.wait()
        assert run.run_folder.is_claimed()  # by what it started: no other run may begin there
        reader = run.reader
        until(lambda: not any(alive(pid) for pid in children.values()), what="the end of all it started")
    assert reader.closed
    recording = read(tmp_path / "x.rrd")
    assert recording.missing == []
    assert len(recording.rows) == reader.head > 0


def test_the_bench_of_stop_latencies_works(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "bench", "stop-latency", "--trials", "1"], env=environment(tmp_path), cwd=ROOT,
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "supervisor killed: after the fault, worst" in done.stdout
