"""Which of the longer tests a run of CI takes."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence


def sampled(cases: Sequence[Mapping[str, int]], count: int | None = None) -> set[int]:
    """The numbers of some cases; each case is given by a number for its value of each parameter.

    `count`: how many, evenly spaced; left out: as few as a greedy search needs for each value to occur once.
    """
    if count is not None:
        last, steps = len(cases) - 1, max(count - 1, 1)
        return {round(i * last / steps) for i in range(count)}
    open_ = {pair for case in cases for pair in case.items()}
    taken: set[int] = set()
    while open_:
        best = max(range(len(cases)), key=lambda i: len(open_ & cases[i].items()))
        taken.add(best)
        open_ -= cases[best].items()
    return taken


def third(file: str) -> int:
    """In which of three parts (0, 1, 2) a file of tests is: about as long as each other, and the same on any machine.

    Args:
        file: its path in the project, with slashes.
    """
    return zlib.crc32(file.encode()) % 3
