"""Stop frames: the newest whole one, whatever the writer was doing when it died."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from runtime.ipc.stop_slots import FRAME, StopSlots


@given(frames=st.lists(st.tuples(st.integers(0, 2), st.binary(min_size=1, max_size=FRAME)), max_size=20))
def test_another_process_reads_the_newest_frame_of_each_slot(tmp_path_factory, frames: list[tuple[int, bytes]]) -> None:
    path = tmp_path_factory.mktemp("stops") / "slots"
    writer, reader = StopSlots.create(path), StopSlots(path)
    newest = {0: b"", 1: b"", 2: b""}
    for slot, frame in frames:
        writer.write(slot, frame)
        newest[slot] = frame
        assert {s: reader.read(s) for s in newest} == newest
    writer.close()
    reader.close()


def test_a_death_while_writing_leaves_the_frame_before(tmp_path: Path) -> None:
    slots = StopSlots.create(tmp_path / "slots")
    slots.write(0, b"hold")
    before = slots._map[0]  # which buffer is valid
    slots.write(0, b"limp")
    slots._map[0] = before  # it died before it could say that the second is valid
    assert slots.read(0) == b"hold"
    slots.clear(0)
    assert slots.read(0) == b""


def test_a_frame_that_does_not_fit_leaves_the_one_before(tmp_path: Path) -> None:
    slots = StopSlots.create(tmp_path / "slots")
    slots.write(0, b"hold")
    slots.write(0, bytes(FRAME + 1))
    assert slots.read(0) == b"hold"
