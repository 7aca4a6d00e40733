"""The recorder process: every row, through kill -9, torn tails, a full disk; rerun's CLI as an oracle."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import psutil
import pytest
from helpers_recording import make_layout, make_rows, make_run, write_run

from runtime.errors import RecordingError
from runtime.layout import Layout
from runtime.recorder import __main__ as command
from runtime.recorder import merge as merging
from runtime.recorder import viewer
from runtime.recorder.framing import HEADER, strip, whole
from runtime.recorder.process import Recorder, watch
from runtime.recorder.reader import read
from runtime.recorder.segments import Segments, check_target, folder_of, listed
from runtime.recorder.stream import Stream
from runtime.ring import RingReader

HELPER = Path(__file__).parents[1] / "helpers_recording.py"


def start_writer(folder: Path, rows: int, rate: float, extra: int = 40) -> subprocess.Popen[str]:
    command = [sys.executable, str(HELPER), str(folder), str(rows), str(rate), str(extra)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def start_recorder(folder: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "runtime.recorder", str(folder), "--out", str(out), *more]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def wait_for(condition, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.01)


def expected(layout: Layout, count: int) -> np.ndarray:
    return np.concatenate([make_rows(layout, min(100, count + 1 - at), at) for at in range(1, count + 1, 100)])


def rerun(*arguments: str) -> subprocess.CompletedProcess[str]:
    spec = find_spec("rerun_cli")
    assert spec is not None
    assert spec.origin is not None
    binary = Path(spec.origin).parent / "rerun"
    return subprocess.run(
        [binary, *arguments], capture_output=True, text=True, env={**os.environ, "CI": "1"}, check=False
    )


def make_segments(folder: Path, layout: Layout, count: int, batch: int = 250) -> None:
    """Segments as the recorder writes them, without its process."""
    layout.save(folder.parent / "layout.json")
    stream = Stream((folder.parent / "layout.json").read_text())
    binary = stream.recording.binary_stream()
    stream.prologue(None)
    head = binary.read()
    segments = Segments(folder, head[:HEADER] + strip(head))
    rows = expected(layout, count)
    for at in range(0, count, batch):
        part = rows[at : at + batch]
        stream.rows(np.arange(at + 1, at + 1 + len(part)), part)
        segments.write(strip(binary.read()))
    segments.close()


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
            wait_for(lambda goal=goal: ring.consumed >= goal)
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
    assert [n.text for n in recording.notes] == [f"row {i}: Grüße" for i in range(500, count + 1, 500)]
    assert recording.notes[3].cycle == 2041
    verified = rerun("rrd", "verify", str(out))
    assert verified.returncode == 0, verified.stderr
    shown = rerun("rrd", "print", str(out)).stdout
    for path in (
        "/glove/position",
        "/finger/position_command/applied",
        "/loop/cycle",
        "/scenery/box",
        "/scenery/capsule",
        "/hand/tips",
        "/notes",
    ):
        assert f" - {path} - " in shown


def test_segments_cut_anywhere_give_a_prefix_bit_for_bit(tmp_path: Path) -> None:
    layout = make_layout()
    make_segments(tmp_path / "whole", layout, 600, batch=50)
    data = (tmp_path / "whole" / "000001.rrd").read_bytes()
    rows = expected(layout, 600)
    folder = tmp_path / "torn"
    folder.mkdir()
    choose = random.Random(7)
    counts = []
    for cut in [0, 5, HEADER, HEADER + 3, len(data) - 1, *(choose.randrange(len(data)) for _ in range(25))]:
        (folder / "000001.rrd").write_bytes(data[:cut])
        try:
            recording = read(folder)
        except RecordingError:
            # Nothing of a row is left: only if the cut is before the first batch's end.
            assert cut < len(data) / 4
            continue
        k = len(recording.rows)
        counts.append((cut, k))
        assert np.array_equal(recording.rows, rows[:k])
        assert recording.missing == []
        assert recording.salvaged == cut - whole(folder / "000001.rrd")
    # No batch that was whole is given up: later cuts never give fewer rows, the last nearly all.
    counts.sort()
    assert [k for _, k in counts] == sorted(k for _, k in counts)
    assert counts[-1][1] >= 550
    assert len(counts) > 15


def test_zeros_after_a_power_cut_are_salvaged(tmp_path: Path) -> None:
    layout = make_layout()
    make_segments(tmp_path / "seg", layout, 500)
    with open(tmp_path / "seg" / "000001.rrd", "ab") as file:
        file.write(bytes(5000))
    recording = read(tmp_path / "seg")
    assert len(recording.rows) == 500
    assert recording.salvaged == 5000


def test_a_missing_segment_shows_as_a_gap_and_duplicates_vanish(tmp_path: Path) -> None:
    layout = make_layout()
    make_segments(tmp_path / "a", layout, 300, batch=100)
    folder = tmp_path / "b"
    folder.mkdir()
    data = (tmp_path / "a" / "000001.rrd").read_bytes()
    (folder / "000001.rrd").write_bytes(data)
    (folder / "000002.rrd").write_bytes(data)
    recording = read(folder)
    assert np.array_equal(recording.rows, expected(layout, 300))
    stream = Stream((tmp_path / "layout.json").read_text())
    binary = stream.recording.binary_stream()
    stream.prologue(None)
    stream.rows(np.arange(401, 451), expected(layout, 450)[400:])
    (folder / "000003.rrd").write_bytes(binary.read())
    recording = read(folder)
    assert recording.missing == [(301, 400)]
    assert np.array_equal(recording.rows[300:], expected(layout, 450)[400:])


def test_a_black_box_is_read(tmp_path: Path) -> None:
    layout = make_layout()
    run, ring, _ = make_run(tmp_path / "box", layout, capacity=256)
    for row in expected(layout, 400):
        ring.append(row)
    ring.rows[400 % 256, 0] = 0  # the writer died inside row 401
    recording = read(run.path)
    assert recording.missing == [(1, int(recording.sequence[0]) - 1)]
    assert recording.sequence[-1] == 400
    assert np.array_equal(recording.rows, expected(layout, 400)[recording.sequence - 1])
    assert len(recording.rows) >= 255
    assert recording.notes == []


def test_what_is_not_a_recording_is_refused_with_its_reason(tmp_path: Path) -> None:
    import rerun as rr

    text = tmp_path / "text.rrd"
    text.write_text("hello, I am not a recording")
    foreign = tmp_path / "foreign.rrd"
    with rr.RecordingStream("someone_else") as recording:
        recording.save(foreign)
        recording.log("x", rr.Scalars(1.0))
    other = tmp_path / "other.rrd"
    stream = rr.RecordingStream("srl")
    stream.save(other)
    stream.send_property("srl", rr.AnyValues(format=99, layout="{}"))
    stream.flush()
    stream.disconnect()
    (tmp_path / "nothing").mkdir()
    reasons = {
        text: "isn't a rerun recording",
        foreign: "no run of srl",
        other: "format is 99",
        tmp_path / "nothing": "neither segments nor a black box",
        tmp_path / "absent.rrd": "no such file",
    }
    for path, reason in reasons.items():
        with pytest.raises(RecordingError, match=reason):
            read(path)


def test_an_existing_recording_is_never_overwritten(tmp_path: Path) -> None:
    out = tmp_path / "out.rrd"
    check_target(out)
    out.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="already"):
        check_target(out)
    run, ring, _ = make_run(tmp_path / "run", make_layout())
    ring.finish()
    with pytest.raises(RecordingError, match="already"):
        Recorder(run, out, view=False).run()
    assert out.read_bytes() == b"precious"
    folder_of(tmp_path / "new.rrd").mkdir()
    (folder_of(tmp_path / "new.rrd") / "000001.rrd").write_bytes(b"")
    with pytest.raises(RecordingError, match="unfinished"):
        check_target(tmp_path / "new.rrd")


def test_a_merge_that_is_not_complete_keeps_the_segments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.rrd"
    make_segments(folder_of(out), make_layout(), 500)

    def loses_a_row(self: Stream, sequence: np.ndarray, rows: np.ndarray) -> None:
        send(self, sequence[1:], rows[1:])

    send = Stream.rows
    monkeypatch.setattr(Stream, "rows", loses_a_row)
    with pytest.raises(RecordingError, match=r"499 of 500 rows.*kept"):
        merging.merge(out)
    assert not out.exists()
    monkeypatch.undo()
    monkeypatch.setattr(merging, "free_bytes", lambda _: 1000)
    with pytest.raises(RecordingError, match="room"):
        merging.merge(out)
    monkeypatch.undo()
    assert len(listed(folder_of(out))) == 1
    assert merging.merge(out) == 500
    assert len(read(out).rows) == 500


def test_a_full_disk_is_waited_out_and_harms_nothing(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small tmpfs takes root")
    ballast = disk / "ballast"
    recorder = None
    try:
        ballast.write_bytes(bytes(2 << 20))
        layout = make_layout()
        run, ring, notes = make_run(tmp_path / "run", layout)
        out = disk / "out.rrd"
        recorder = start_recorder(run.path, out)
        write_run(run, ring, notes, layout, 500, 2500.0)
        wait_for(lambda: ring.consumed == 500)
        write_run(run, ring, notes, layout, 2000, 2500.0, first=501)  # in all 2.7 MB
        complaint = recorder.stderr.readline()
        assert 0 < ring.consumed < 2500
        assert recorder.poll() is None
        before = read(folder_of(out))
        assert np.array_equal(before.rows, expected(layout, len(before.rows)))
        assert len(before.rows) == ring.consumed
        ballast.unlink()
        wait_for(lambda: ring.consumed == 2500)
        ring.finish()
        # No room for the merged file beside the segments: they are kept, and it is said.
        assert recorder.wait(30) == 1
        said = recorder.stderr.read()
        assert "No space left" in complaint
        assert "No space left" not in said
        assert "recording again" in said
        assert "kept" in said
        assert not out.exists()
        after = read(folder_of(out))
        assert np.array_equal(after.rows, expected(layout, 2500))
    finally:
        if recorder is not None:
            recorder.kill()
            recorder.wait()
        subprocess.run(["umount", str(disk)], check=False)


def test_the_viewer_listens_on_loopback_only_and_dies_with_the_recorder(tmp_path: Path) -> None:
    layout = make_layout()
    run, ring, notes = make_run(tmp_path / "run", layout)
    recorder = start_recorder(run.path, tmp_path / "out.rrd", "--view")
    try:
        write_run(run, ring, notes, layout, 500, 1000.0)
        assert recorder.stderr is not None
        line = recorder.stderr.readline()
        assert "viewer: http://127.0.0.1:" in line
        me = psutil.Process(recorder.pid)
        servers = me.children(recursive=True)
        ears = [c for p in [me, *servers] for c in p.net_connections("inet") if c.status == psutil.CONN_LISTEN]
        assert len(ears) >= 2
        assert {c.laddr.ip for c in ears} == {"127.0.0.1"}
        wait_for(lambda: ring.consumed == 500)
        recorder.send_signal(signal.SIGKILL)
        recorder.wait()
        _, alive = psutil.wait_procs(servers, 5)
        assert alive == []
    finally:
        recorder.kill()
        recorder.wait()


def test_a_merge_killed_while_tidying_up_is_finished_by_the_next(tmp_path: Path) -> None:
    out = tmp_path / "out.rrd"
    layout = make_layout()
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in expected(layout, 300):
        ring.append(row)
    ring.finish()
    make_segments(folder_of(out), layout, 300)
    kept = (folder_of(out) / "000001.rrd").read_bytes()
    merging.merge(out)
    folder_of(out).mkdir()
    (folder_of(out) / "000001.rrd").write_bytes(kept)
    before = out.read_bytes()
    assert Recorder(run, out, view=False).run() == 0
    assert not folder_of(out).exists()
    assert out.read_bytes() == before


@pytest.mark.slow
def test_a_stop_signal_is_outlived_until_the_loop_is_silent(tmp_path: Path) -> None:
    layout = make_layout()
    run, ring, notes = make_run(tmp_path / "run", layout)
    recorder = start_recorder(run.path, tmp_path / "out.rrd")
    try:
        write_run(run, ring, notes, layout, 200, 0)
        wait_for(lambda: ring.consumed == 200)
        recorder.send_signal(signal.SIGTERM)
        write_run(run, ring, notes, layout, 300, 500.0, first=201)
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
        Recorder(run, out, view=False)


def test_a_restart_goes_on_from_the_ring_without_reading_the_segments(tmp_path: Path) -> None:
    layout, out = make_layout(), tmp_path / "out.rrd"
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in expected(layout, 400):
        ring.append(row)
    make_segments(folder_of(out), layout, 300)
    RingReader(run.rows, recorder=True).set_consumed(250)  # killed after a write, before it counted as taken
    ring.finish()
    assert Recorder(run, out, view=False).run() == 0
    recording = read(out)
    assert np.array_equal(recording.sequence, np.arange(1, 401))
    assert np.array_equal(recording.rows, expected(layout, 400))


def test_a_viewer_that_does_not_start_costs_no_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layout, out = make_layout(), tmp_path / "out.rrd"
    run, ring, _ = make_run(tmp_path / "run", layout)
    ring.append(expected(layout, 1)[0])
    ring.finish()
    monkeypatch.setattr(viewer, "find_spec", lambda _: None)
    assert Recorder(run, out, view=True).run() == 0
    assert len(read(out).rows) == 1
    assert watch(run) == 0


def test_watching_keeps_nothing_and_leaves_the_recorders_mark(tmp_path: Path) -> None:
    layout = make_layout()
    run, ring, notes = make_run(tmp_path / "run", layout)
    watcher = subprocess.Popen(
        [sys.executable, "-m", "runtime.recorder", str(run.path), "--view"], stderr=subprocess.PIPE, text=True
    )
    try:
        assert watcher.stderr is not None
        assert "viewer: http://127.0.0.1:" in watcher.stderr.readline()
        before = sorted(p.name for p in tmp_path.rglob("*"))
        write_run(run, ring, notes, layout, 500, 2500.0)
        ring.finish()
        assert watcher.wait(30) == 0
        assert watcher.stderr.read() == ""
        assert sorted(p.name for p in tmp_path.rglob("*")) == before
        assert ring.consumed == 0
    finally:
        watcher.kill()
        watcher.wait()


@pytest.mark.parametrize(("arguments", "reason"), [([], "--out, --view or both"), (["--view"], "no run is here")])
def test_wrong_arguments_and_an_absent_run_are_refused(
    tmp_path: Path,
    arguments: list[str],
    reason: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["runtime.recorder", str(tmp_path), *arguments])
    monkeypatch.setattr(command, "die_with_parent", lambda _: None)
    try:
        code = command.main()
    except SystemExit as end:  # argparse's
        code = end.code
    assert code == 2
    assert reason in capsys.readouterr().err
