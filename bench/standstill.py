"""When the machine itself stood still: a process on each processor, above all others, that only sleeps and wakes.

    python -m bench.standstill FOLDER    # until SIGTERM; a file of each processor, a line of it for each gap: its begin
                                         # and its end, ns of CLOCK_MONOTONIC

A virtual machine whose host pauses it, or gives its processor away, loses periods of any loop. What a loop loses while
nothing wakes this process isn't the loop's own. Real-time processes that take more than their share of a processor
(sched_rt_runtime_us) are held up by the kernel, this one among them: that counts as the machine's, too.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

PRIORITY: Final = 95  # of SCHED_FIFO: above the loop's
NAP: Final = 0.002  # s
FILE: Final = "gaps-{}"
GAP: Final = 4_000_000  # ns from one waking to the next that count


def watch(processor: int, into: Path) -> None:
    """Writes down the gaps on a processor until it is ended.

    Raises:
        PermissionError: it may not come before the loop, so what it missed would say nothing.
    """
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    with into.open("w") as file:
        last = time.monotonic_ns()
        while True:
            time.sleep(NAP)
            now = time.monotonic_ns()
            if now - last > GAP:
                file.write(f"{last} {now}\n")
                file.flush()
            last = now


def gaps(folder: Path) -> NDArray[np.int64]:
    """(m, 2) begin and end, ns, of all that were written down; a line that isn't whole doesn't count."""
    lines = [line.split() for file in folder.glob(FILE.format("*")) for line in file.read_text().split("\n")[:-1]]
    return np.array(lines, np.int64).reshape(-1, 2)


def own(losses: NDArray[np.int64], stood: NDArray[np.int64], period: float) -> int:
    """How many of the lost periods the loop lost by itself.

    Args:
        losses: (k, 3) begin and end, ns, of the time in which the loop missed periods, and how many.
        stood: (m, 2) begin and end, ns, of the times in which the machine stood still.
        period: ns, of the loop.
    """
    found = 0
    for begin, end, lost in losses.tolist():
        shared = np.minimum(stood[:, 1], end) - np.maximum(stood[:, 0], begin)
        # The longest of the processors' gaps. A loop misses a period if it is held up for what its cycle leaves of one.
        if shared.max(initial=0) < 0.8 * lost * period:
            found += lost
    return found


def main() -> int:
    """Watches every processor that this process may use."""
    children = []
    for processor in sorted(os.sched_getaffinity(0)):
        if not (child := os.fork()):
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            with suppress(PermissionError):  # then nothing is written down, and each loss counts as the loop's own
                watch(processor, Path(sys.argv[1]) / FILE.format(processor))
            os._exit(0)
        children.append(child)
    signal.signal(signal.SIGTERM, lambda *_: None)
    signal.pause()
    for child in children:
        os.kill(child, signal.SIGTERM)  # not waited for yet, so its number is no other's
    return 0


if __name__ == "__main__":
    sys.exit(main())
