"""Stop frames: the newest whole one, whatever the writer was doing when it died."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.ipc.stop_slots import FRAMES, StopSlots

# As many as fit, each with its length in front.
several = st.lists(st.binary(min_size=1, max_size=400), max_size=5).map(tuple)


@given(frames=st.lists(st.tuples(st.integers(0, 2), several), max_size=20))
def test_another_process_reads_the_newest_frames_of_each_slot(
    tmp_path_factory: pytest.TempPathFactory, frames: list[tuple[int, tuple[bytes, ...]]]
) -> None:
    path = tmp_path_factory.mktemp("stops") / "slots"
    writer, reader = StopSlots.create(path), StopSlots(path)
    newest: dict[int, list[bytes]] = {0: [], 1: [], 2: []}
    for slot, frame in frames:
        writer.write(slot, frame)
        newest[slot] = list(frame)
        assert {s: reader.read(s) for s in newest} == newest
    writer.close()
    reader.close()


def test_a_death_while_writing_leaves_the_frame_before(tmp_path: Path) -> None:
    slots = StopSlots.create(tmp_path / "slots")
    slots.write(0, (b"hold",), 5)
    before = slots._map[0]  # which buffer is valid
    slots.write(0, (b"limp",))
    slots._map[0] = before  # it died before it could say that the second is valid
    assert (slots.read(0), slots.until(0)) == ([b"hold"], 5)
    slots.clear(0)
    assert slots.read(0) == []


def test_a_frame_that_does_not_fit_leaves_the_one_before(tmp_path: Path) -> None:
    slots = StopSlots.create(tmp_path / "slots")
    slots.write(0, (b"hold",), 5)
    long = b"limp", bytes(FRAMES)
    assert not slots.write(0, long)
    slots.write(0, long, 7)
    assert (slots.read(0), slots.until(0)) == ([b"hold"], 5)


def test_the_same_frames_may_be_written_for_longer(tmp_path: Path) -> None:
    slots, hold = StopSlots.create(tmp_path / "slots"), (b"hold",)
    assert slots.until(0) == 0
    for until in (5, 6, 0, 7):
        assert slots.write(0, hold, until)
        assert (slots.read(0), slots.until(0)) == ([b"hold"], until)
