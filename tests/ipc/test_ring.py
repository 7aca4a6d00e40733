"""The ring: rows whole and in order, laps counted, a torn row never returned."""

from __future__ import annotations

import multiprocessing
import os
import resource
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.ring import RingReader, RingWriter


def _row(k: int, width: int = 6) -> np.ndarray:
    return np.arange(width, dtype=np.int64) * 1_000_003 + k


@given(batches=st.lists(st.integers(0, 25), max_size=12))
def test_rows_come_back_in_order_and_losses_are_counted(
    tmp_path_factory: pytest.TempPathFactory, batches: list[int]
) -> None:
    path = tmp_path_factory.mktemp("ring") / "rows"
    with RingWriter.create(path, 6, 16) as writer, RingReader(path) as reader:
        written = taken = 0
        for batch in batches:
            for _ in range(batch):
                written += 1
                writer.append(_row(written))
            before = reader.lost
            rows = reader.take()
            assert reader.lost - before == max(0, batch - 16)
            taken += len(rows)
            expected = range(written - len(rows) + 1, written + 1)
            assert [int(r[0]) for r in rows] == list(expected)
        assert taken + reader.lost == written


def test_a_torn_row_is_not_returned(tmp_path: Path) -> None:
    with RingWriter.create(tmp_path / "rows", 6, 16) as writer, RingReader(tmp_path / "rows") as reader:
        for k in range(1, 5):
            writer.append(_row(k))
        writer.rows[3, 0] = 0  # the writer died in the middle of row 4
        assert reader.newest() is None
        assert len(reader.take()) == 0 or reader.sequence < 4


def test_a_writer_goes_on_where_it_ended(tmp_path: Path) -> None:
    with RingWriter.create(tmp_path / "rows", 6, 16) as writer:
        writer.append(_row(1))
    with RingWriter(tmp_path / "rows") as writer, RingReader(tmp_path / "rows", after=1) as reader:
        assert writer.append(_row(2)) == 2
        assert [int(r[0]) for r in reader.take()] == [2]


def _write_fast(path: Path, count: int) -> None:
    writer = RingWriter(path)
    for k in range(1, count + 1):
        writer.append(np.full(64, k, np.int64))
    writer.finish()


@pytest.mark.slow
def test_a_reader_beside_a_fast_writer_never_sees_a_mixed_row(tmp_path: Path) -> None:
    """The writer laps the reader all the time; every row returned is whole."""
    path = tmp_path / "rows"
    RingWriter.create(path, 64, 32).close()
    process = multiprocessing.get_context("spawn").Process(target=_write_fast, args=(path, 60_000))
    process.start()
    with RingReader(path) as reader:
        seen, closed = 0, False
        while not closed:
            closed = reader.closed
            rows = reader.take()
            assert (rows == rows[:, :1]).all()
            seen += len(rows)
        seen += len(reader.take())
        assert seen + reader.lost == 60_000
    process.join()


def test_what_isnt_a_ring_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("hello" * 2000)
    (tmp_path / "short").write_text("hello")
    for name in ("text", "short", "missing"):
        with pytest.raises(RecordingError):
            RingReader(tmp_path / name)


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="needs a folder in memory, where run folders are")
def test_the_writer_takes_no_fault_at_pages_it_writes_for_the_first_time() -> None:
    width, capacity = 254, 512  # two rows a page
    with (
        tempfile.TemporaryDirectory(dir="/dev/shm") as folder,
        RingWriter.create(Path(folder) / "rows", width, capacity) as writer,
    ):
        row = np.zeros(width, np.int64)
        writer.append(row)
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
        for _ in range(capacity - 1):
            writer.append(row)
        assert resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before < 25
