"""Segments become one recording: cut anywhere, zeroed, missing, doubled, and never over another."""

from __future__ import annotations

import errno
import os
import random
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from helpers.recording import make_layout, make_run
from helpers.segments import expected, make_segments
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.events import Event, Level
from srl.runtime.recorder import stream
from srl.runtime.recorder.merge import Merger
from srl.runtime.recorder.process import Recorder
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.framing import HEADER, whole
from srl.runtime.recording.reader import read
from srl.runtime.recording.segments import check_target, claim, folder_of, listed, numbered
from srl.runtime.recording.source import Source


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
    output = [Event(5, Level.INFO, 1, "ready"), Event(7, Level.WARNING, 3, "stopped")]
    make_segments(tmp_path / "seg", make_layout(), 10, events=output)
    assert read(tmp_path / "seg").events == output


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


def merger(out: Path) -> Merger:
    return Merger(out, (out.parent / "layout.json").read_text())


def test_a_merge_that_is_not_complete_keeps_the_segments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.rrd"
    folder = folder_of(out)
    make_segments(folder, make_layout(), 500)

    def loses_a_row(self: Stream, sequence: np.ndarray, rows: np.ndarray) -> None:
        send(self, sequence[1:], rows[1:])

    send = Stream.pack
    monkeypatch.setattr(Stream, "pack", loses_a_row)
    with pytest.raises(RecordingError, match=r"499 of 500 rows.*kept"):
        merger(out).finish()
    assert not out.exists()
    monkeypatch.undo()
    assert np.array_equal(read(folder).rows, expected(make_layout(), 500))
    merger(out).finish()
    assert np.array_equal(read(out).rows, expected(make_layout(), 500))
    assert not folder.exists()


def test_at_the_end_nothing_is_packed_and_a_merge_under_way_gives_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, layout = tmp_path / "out.rrd", make_layout(extra=3)
    output = [Event(5, Level.INFO, 1, "ready")]
    prologue = make_segments(folder_of(out), layout, 300, events=output)
    (segment,) = numbered(folder_of(out))
    merging = Merger(out, (tmp_path / "layout.json").read_text(), prologue)
    pack = Stream.pack

    def until_the_run_ends(self: Stream, *rows: np.ndarray) -> None:
        pack(self, *rows)
        merging.hurry()

    monkeypatch.setattr(Stream, "pack", until_the_run_ends)
    merging.merge([segment])
    assert segment.exists()
    monkeypatch.setattr(Stream, "pack", pytest.fail)
    merging.finish()
    found = read(out)
    assert np.array_equal(found.rows, expected(layout, 300))
    assert (found.events, found.missing, found.salvaged) == (output, [], 0)
    shown = [chunk.entity_path for chunk in rr.chunk.RrdReader(out).stream()]
    assert shown.count("/glove/position") == 2, "its names, and its numbers once"


def test_what_was_merged_is_on_the_disk_with_its_name_before_its_segment_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut leaves the rows in one place or the other."""
    out, layout = tmp_path / "out.rrd", make_layout()
    make_segments(folder_of(out), layout, 300)
    done: list[str] = []
    sync, unlink = os.fsync, Path.unlink

    def kept(descriptor: int) -> None:
        done.append(f"{Path(os.readlink(f'/proc/self/fd/{descriptor}')).name} kept")
        sync(descriptor)

    def gone(path: Path, missing_ok: bool = False) -> None:
        done.append(f"{path.name} gone")
        unlink(path, missing_ok)

    monkeypatch.setattr(os, "fsync", kept)
    monkeypatch.setattr(Path, "unlink", gone)
    merging = merger(out)
    merging.merge(numbered(folder_of(out)))
    before = done[: done.index("000001.rrd gone")]
    assert set(before) == {"out.rrd.segments kept", f"{tmp_path.name} kept", "000000.rrd kept"}
    done.clear()
    merging.finish()
    assert done[-1] == f"{tmp_path.name} kept", "the recording's own name"


@pytest.mark.parametrize("call", ["write", "fsync", "pread", "unlink", "rename"])
def test_whatever_fails_in_a_merge_loses_nothing_and_is_made_good_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    out, layout = tmp_path / "out.rrd", make_layout(extra=3)
    make_segments(folder_of(out), layout, 300, events=[Event(5, Level.INFO, 1, "ready")])
    first = merger(out)
    real = {"unlink": Path.unlink, "rename": Path.rename}.get(call) or getattr(os, call)
    places = {"unlink": (Path, "unlink"), "rename": (Path, "rename")}

    def fails(*given: object, **_: object) -> object:
        if call == "write" and len(given[1]) > 100_000:  # a half of it reaches the disk
            real(given[0], given[1][: len(given[1]) // 2])
            return fails(given[0], b"")
        if call == "pread":
            return bytes(given[1])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(*places.get(call, (os, call)), fails)
        with pytest.raises(RecordingError, match=r"can't be.*kept"):
            first.finish()
    there = read(folder_of(out))
    assert np.array_equal(there.rows, expected(layout, 300))
    assert not out.exists()
    first.finish()
    found = read(out)
    assert np.array_equal(found.rows, expected(layout, 300))
    assert [event.text for event in found.events] == ["ready"]
    assert (found.missing, found.salvaged) == ([], 0)
    assert not folder_of(out).exists()
    kinds = [chunk.entity_path for chunk in rr.chunk.RrdReader(out).stream()]
    assert kinds.count("/rows") == 1, "nothing was written twice"


def cut(grown: Path, at: int, zeros: int, folder: Path) -> int:
    """Copies a growing recording with its growing file cut; returns how many bytes of that aren't whole messages."""
    data = (folder_of(grown / "out.rrd") / "000000.rrd").read_bytes()[:at] + bytes(zeros)
    folder.mkdir(parents=True)
    (folder / "000000.rrd").write_bytes(data)
    shutil.copy(folder_of(grown / "out.rrd") / "000002.rrd", folder)
    shutil.copy(grown / "layout.json", folder.parent)
    return len(data) - whole(folder / "000000.rrd")


@given(at=st.integers(0, 1 << 40), zeros=st.sampled_from([0, 0, 1, 300]))
@example(1, 1).via("the magic begun")
@example(7, 9).via("the header begun")
@settings(max_examples=20, deadline=None, phases=[Phase.explicit, Phase.generate])
def test_a_recording_cut_at_any_byte_while_it_grows_gives_all_that_stands_in_it_and_says_what_is_gone(
    grown: Path, at: int, zeros: int
) -> None:
    size = (folder_of(grown / "out.rrd") / "000000.rrd").stat().st_size
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "out.rrd.segments"
        torn = cut(grown, at % (size + 1), zeros, folder)
        found = read(folder)
    assert np.array_equal(found.rows, expected(make_layout(extra=3), 400)[found.sequence - 1])
    assert found.salvaged == torn or (zeros and found.salvaged > torn)  # zeros that end a message spoil it
    # The rows of the segment are there whatever the growing file lost; what that had lost is a gap.
    assert (found.missing, len(found.rows)) in (([], 400), ([(1, 200)], 200))
    if at % (size + 1) == size:
        assert not found.missing


@pytest.mark.slow
@pytest.mark.sampled(7)
@pytest.mark.parametrize("at", [0, 1, 11, 12, 100, -1, *np.random.default_rng(5).integers(0, 300_000, 8).tolist()])
def test_a_recorder_goes_on_with_a_growing_file_that_is_cut_anywhere(grown: Path, tmp_path: Path, at: int) -> None:
    out = tmp_path / "out.rrd"
    cut(grown, at, 0, folder_of(out))
    there = read(folder_of(out))
    merger(out).finish()
    done = read(out)
    assert np.array_equal(done.rows, there.rows)
    assert done.salvaged == 0
    assert "/profile" in {chunk.entity_path for chunk in rr.chunk.RrdReader(out).stream()}


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 400 rows while it grows: 200 of them are merged, the others a segment."""
    out, layout = tmp_path_factory.mktemp("grown") / "out.rrd", make_layout(extra=3)
    make_segments(folder_of(out), layout, 200)
    segment = folder_of(out) / "000001.rrd"
    merging = merger(out)
    merging.merge([segment])
    merging.close()
    stream = Stream((out.parent / "layout.json").read_text())
    binary = stream.recording.binary_stream()
    stream.head()
    stream.pack(np.arange(201, 401), expected(layout, 400)[200:])
    (folder_of(out) / "000002.rrd").write_bytes(binary.read())
    return out.parent


def test_a_recording_is_read_whole_while_its_segments_are_merged(tmp_path: Path) -> None:
    out, layout = tmp_path / "out.rrd", make_layout(extra=3)
    make_segments(folder_of(out), layout, 200)
    source = Source(listed(folder_of(out)))
    blocks = source.blocks()
    got = [next(blocks)]
    merging = merger(out)
    merging.merge(numbered(folder_of(out)))
    assert numbered(folder_of(out)) == []
    got += list(blocks)
    assert np.array_equal(np.concatenate([rows for _, rows in got]), expected(layout, 200))
    gone = Source([folder_of(out) / "000001.rrd"])  # listed before it was merged
    assert sum(len(s) for s, _ in gone.blocks()) == 200
    merging.finish()
    with pytest.raises(RecordingError, match="has gone"):
        list(Source([folder_of(out) / "000000.rrd"]).blocks())


def test_a_recorder_killed_after_the_last_merge_has_finished(tmp_path: Path) -> None:
    out, layout = tmp_path / "out.rrd", make_layout()
    run, ring, _ = make_run(tmp_path / "run", layout)
    for row in expected(layout, 300):
        ring.append(row)
    ring.finish()
    assert Recorder(run, out).run() == 0
    before = out.read_bytes()
    folder_of(out).mkdir()  # killed before it removed the folder
    assert Recorder(run, out).run() == 0
    assert not folder_of(out).exists()
    assert out.read_bytes() == before


def test_two_recorders_never_write_into_one_folder(tmp_path: Path) -> None:
    out = tmp_path / "out.rrd"
    held = claim(folder_of(out))
    run, _, _ = make_run(tmp_path / "run", make_layout())
    with pytest.raises(RecordingError, match="another run is being recorded there"):
        Recorder(run, out)
    os.close(held)
    os.close(claim(folder_of(out)))
