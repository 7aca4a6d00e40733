"""The recorder process: every row, through kill -9, torn tails, a full disk; rerun's CLI as an oracle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from helpers import environment
from helpers.recording import make_layout, make_run, write_run
from helpers.segments import expected, make_segments
from helpers.small_disk import small_disk
from helpers.wait import until

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.child import FINAL
from srl.runtime.ipc.ring import RingReader
from srl.runtime.recorder import __main__ as command
from srl.runtime.recorder import base
from srl.runtime.recorder.merge import Merger
from srl.runtime.recorder.process import Recorder
from srl.runtime.recording.reader import read
from srl.runtime.recording.segments import folder_of, numbered

START = 120.0  # s that a recorder may take to begin on a busy machine


def start_writer(folder: Path, rows: int, rate: float, extra: int = 40) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "helpers.recording", str(folder), str(rows), str(rate), str(extra)]
    writer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment())
    assert writer.stdout is not None
    assert writer.stdout.readline() == "ready\n"
    return writer


def start_recorder(folder: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "srl.runtime.recorder", str(folder), "--out", str(out), *more]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def rerun(*arguments: str) -> subprocess.CompletedProcess[str]:
    spec = find_spec("rerun_cli")
    assert spec is not None
    assert spec.origin is not None
    binary = Path(spec.origin).parent / "rerun"
    return subprocess.run(
        [binary, *arguments], capture_output=True, text=True, env={**os.environ, "CI": "1"}, check=False
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("count", "kills"), [(3000, [1000]), pytest.param(20000, [4000, 11000], marks=pytest.mark.slow)]
)
def test_rows_survive_kill_9_and_merge_bit_for_bit(tmp_path: Path, count: int, kills: list[int]) -> None:
    run, out = tmp_path / "run", tmp_path / "out.rrd"
    writer = start_writer(run, count, 0)
    try:
        ring = RingReader(run / "rows.ring")
        for goal in kills:
            recorder = start_recorder(run, out)
            until(lambda goal=goal: ring.consumed >= goal, timeout=START)
            recorder.send_signal(signal.SIGKILL)
            recorder.wait()
        recorder = start_recorder(run, out)
        assert recorder.wait(60) == 0, recorder.stderr.read()
        assert writer.wait(10) == 0
    finally:
        writer.kill()
    recording = read(out)
    assert not folder_of(out).exists()
    assert np.array_equal(recording.rows, expected(recording.layout, count))
    assert np.array_equal(recording.sequence, np.arange(1, count + 1))
    assert (recording.missing, recording.salvaged) == ([], 0)
    assert [n.text for n in recording.events] == [f"row {i}: Grüße" for i in range(500, count + 1, 500)]
    assert recording.events[3].cycle == 2041
    verified = rerun("rrd", "verify", "--check-footers", "false", str(out))
    assert verified.returncode == 0, verified.stderr
    shown = rerun("rrd", "print", str(out)).stdout
    for path in (
        "/glove/position",
        "/finger/position_command/applied",
        "/loop/cycle",
        "/scenery/box",
        "/scenery/capsule",
        "/hand/tips",
        "/events",
    ):
        assert f" - {path} - " in shown


def test_a_full_disk_is_waited_out_and_harms_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output: list[str] = []
    monkeypatch.setattr(base, "say", output.append)
    monkeypatch.setattr(base, "TIMEOUT", float("inf"))
    layout = make_layout()
    run, ring, events = make_run(tmp_path / "run", layout)
    # No process of its own: on a busy machine its start alone takes long.
    with small_disk(tmp_path / "disk") as disk, ThreadPoolExecutor(1) as thread:
        ballast, out = disk / "ballast", disk / "out.rrd"
        try:
            ballast.write_bytes(bytes(3_500_000))
            recording = thread.submit(Recorder(run, out).run)
            write_run(run, ring, events, layout, 500, 2500.0)
            until(lambda: ring.consumed == 500)
            write_run(run, ring, events, layout, 2000, 2500.0, first=501)  # more than there is room for
            until(lambda: output)
            assert 0 < ring.consumed < 2500
            assert not recording.done()
            before = read(folder_of(out))
            assert np.array_equal(before.rows, expected(layout, len(before.rows)))
            assert len(before.rows) == ring.consumed
            ballast.unlink()
            until(lambda: ring.consumed == 2500)
            ring.finish()
            assert recording.result(60) == 0
            assert ["No space left" in line for line in output if "can't write" in line] == [True], "it is said once"
            assert [line for line in output if "recording again" in line]
            assert np.array_equal(read(out).rows, expected(layout, 2500))
            assert not folder_of(out).exists()
        finally:
            ballast.unlink(missing_ok=True)
            ring.finish()


@pytest.mark.slow
def test_a_stop_signal_is_outlived_until_the_loop_is_silent(tmp_path: Path) -> None:
    layout = make_layout()
    run, ring, events = make_run(tmp_path / "run", layout)
    recorder = start_recorder(run.path, tmp_path / "out.rrd")
    try:
        write_run(run, ring, events, layout, 200, 0)
        until(lambda: ring.consumed == 200, timeout=START)
        recorder.send_signal(signal.SIGTERM)
        write_run(run, ring, events, layout, 300, 500.0, first=201)
        assert recorder.wait(30) == 0
        assert len(read(tmp_path / "out.rrd").rows) == 500
    finally:
        recorder.kill()
        recorder.wait()


def test_segments_of_another_run_are_not_continued(tmp_path: Path) -> None:
    out = tmp_path / "out.rrd"
    make_segments(folder_of(out), make_layout(rate=500), 100)
    run, _, _ = make_run(tmp_path / "run", make_layout())
    with pytest.raises(RecordingError, match="another run"):
        Recorder(run, out)


def test_a_restart_goes_on_from_the_ring_without_reading_the_segments(tmp_path: Path) -> None:
    layout, out = make_layout(), tmp_path / "out.rrd"
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in expected(layout, 400):
        ring.append(row)
    make_segments(folder_of(out), layout, 300)
    RingReader(run.rows, marks=True).set_consumed(250)  # killed after a write, before it counted as taken
    ring.finish()
    assert Recorder(run, out).run() == 0
    recording = read(out)
    assert np.array_equal(recording.sequence, np.arange(1, 401))
    assert np.array_equal(recording.rows, expected(layout, 400))


def test_what_a_recorder_lost_before_it_was_killed_is_told_at_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    layout, out = make_layout(), tmp_path / "out.rrd"
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in expected(layout, 400):
        ring.append(row)
    make_segments(folder_of(out), layout, 200)
    RingReader(run.rows, marks=True).set_consumed(300)  # 201 to 300 were overwritten before it took them
    ring.finish()
    assert Recorder(run, out).run() == FINAL
    assert "300 rows, 100 were lost" in capsys.readouterr().err
    assert read(out).missing == [(201, 300)]


def test_what_was_merged_before_is_counted(tmp_path: Path) -> None:
    layout, out = make_layout(), tmp_path / "out.rrd"
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in expected(layout, 400):
        ring.append(row)
    prologue = make_segments(folder_of(out), layout, 400)
    merger = Merger(out, run.layout.read_text(), prologue)
    merger.merge(numbered(folder_of(out)))
    merger.close()
    RingReader(run.rows, marks=True).set_consumed(400)  # killed before it put the recording in its place
    ring.finish()
    assert Recorder(run, out).run() == 0
    assert np.array_equal(read(out).sequence, np.arange(1, 401))


@pytest.mark.parametrize(("arguments", "reason"), [([], "--out"), (["--out", "run.rrd"], "no run is here")])
def test_wrong_arguments_and_an_absent_run_are_refused(
    tmp_path: Path,
    arguments: list[str],
    reason: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["srl.runtime.recorder", str(tmp_path), *arguments])
    monkeypatch.setattr(command, "Ending", lambda **_: None)  # it would be this process's
    try:
        code = command.main()
    except SystemExit as end:  # argparse's
        code = end.code
    assert code == 2
    assert reason in capsys.readouterr().err
