"""Segments become one recording: cut anywhere, zeroed, missing, doubled, and never over another."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from helpers.recording import make_layout, make_run
from helpers.segments import expected, make_segments

from runtime.contracts.errors import RecordingError
from runtime.ipc.events import Event, Level
from runtime.recorder import merge as merging
from runtime.recorder import stream
from runtime.recorder.process import Recorder
from runtime.recorder.stream import Stream
from runtime.recording.framing import HEADER, whole
from runtime.recording.reader import read
from runtime.recording.segments import check_target, folder_of, listed


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


@pytest.mark.parametrize("names", [("/events", "srl.Event"), ("/notes", "srl.Note")])
def test_events_are_read_as_they_are_called_now_and_as_they_were_in_0_1_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: tuple[str, str]
) -> None:
    monkeypatch.setattr(stream, "EVENTS", names[0])
    monkeypatch.setattr(stream, "EVENT", names[1])
    said = [Event(5, Level.INFO, 1, "ready"), Event(7, Level.WARNING, 3, "stopped")]
    make_segments(tmp_path / "seg", make_layout(), 10, events=said)
    assert read(tmp_path / "seg").events == said


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
    assert recording.events == []


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
        Recorder(run, out).run()
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
    assert Recorder(run, out).run() == 0
    assert not folder_of(out).exists()
    assert out.read_bytes() == before
