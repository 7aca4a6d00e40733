"""What the soak sees of a process: memory that grows, a descriptor that stays open, pages that fault."""

from __future__ import annotations

import mmap
import os
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.soak import Watched
from bench.standstill import gaps, own


def test_a_leak_and_a_descriptor_that_stays_open_are_seen() -> None:
    watched, kept = Watched(), list[mmap.mmap]()
    with ExitStack() as opened:
        for at in range(40):
            kept.append(
                mmap.mmap(-1, 1 << 20, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
            )  # 1 MiB a second: not of what earlier tests gave back
            kept[-1].write(bytes([1]) * (1 << 20))
            if at == 30:
                opened.enter_context(open(os.devnull))
            with open(os.devnull) if at % 5 == 4 else nullcontext():  # for a moment
                watched.look(os.getpid(), float(at))
    line = watched.judged(warm_up=10.0)
    assert line is not None
    assert (line.first_half, line.second_half) == pytest.approx((3600.0, 3600.0), rel=0.2)
    assert line.open_ended == line.open_started + 1
    assert line.open_most == line.open_started + 2
    assert line.main > 0.5 * 60 * (1 << 20) / os.sysconf("SC_PAGE_SIZE")
    assert watched.judged(warm_up=38.0) is None


@pytest.mark.parametrize(
    ("losses", "still", "lost"),
    [
        ([(0, 30, 2)], [(4, 29)], 0),  # it stood still for nearly both
        ([(0, 30, 2)], [(4, 12)], 2),  # not for so long
        ([(0, 30, 2)], [(100, 130)], 2),  # at another time
        ([(0, 30, 2), (50, 70, 1)], [(0, 28)], 1),
        ([(0, 30, 2)], [], 2),
        ([], [(0, 30)], 0),
    ],
)
def test_a_period_is_the_loops_own_loss_unless_the_machine_stood_still(losses: Any, still: Any, lost: int) -> None:
    ms = 1_000_000
    found = own(
        np.array(losses, np.int64).reshape(-1, 3) * [ms, ms, 1], np.array(still, np.int64).reshape(-1, 2) * ms, 10 * ms
    )
    assert found == lost


def test_what_is_written_down_of_each_processor_is_read_and_half_a_line_is_not(tmp_path: Path) -> None:
    for processor, text in ((0, "10 20\n30 40\n"), (1, "15 25\n3")):
        (tmp_path / f"gaps-{processor}").write_text(text)
    assert sorted(gaps(tmp_path).tolist()) == [[10, 20], [15, 25], [30, 40]]
