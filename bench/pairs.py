"""Interleaved pairs: ours, the other, ours, the other, and so on; the median ratio, with an A/A control."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

PAIRS = 20
LEAST = 5  # pairs, however long they take
LONG, BRIEF = 12.0, 5.0  # s after which a measurement takes no further pair; BRIEF in a quick set
QUICK = "SRL_BENCH_QUICK"  # environment: set for a quick set


@dataclass(frozen=True, kw_only=True)
class Row:
    """One comparison.

    Attributes:
        id: the bench's id; several rows may share one.
        ours, other: medians, in `unit`.
        ratio: median over pairs of ours / other.
        control: median over pairs of ours / the next pair's ours: the effect of noise alone.
        interval, control_interval: 95 % of the bootstrapped medians of both; None where there are no pairs.
        pairs: how many were measured; 0 where there are none.
        aim: in words; holds: whether it is met, None if there is none.
    """

    id: str
    what: str
    ours: float
    other: float
    other_name: str
    ratio: float
    control: float | None
    unit: str
    aim: str = ""
    holds: bool | None = None
    interval: tuple[float, float] | None = None
    control_interval: tuple[float, float] | None = None
    pairs: int = 0

    def metrics(self) -> dict[str, Any]:
        """Returns the row for `--json`."""
        return asdict(self)


class PartlyError(Exception):
    """A part of a bench failed: its text says which and why; `rows` are those of the rest."""

    def __init__(self, why: str, rows: list[Row]) -> None:
        super().__init__(why)
        self.rows = rows


def measure(
    ours: Callable[[], dict[str, float]], others: dict[str, Callable[[], dict[str, float]]], pairs: int = PAIRS
) -> Pairs:
    """Runs ours and each other in turn, `pairs` times, or as often as the time lasts (`rounds`), and ours at the end.

    So each pair has ours before and after the others: their ratio is the control. Two neighbouring controls share a
    measurement, so a slow one makes one low and one high; the ratios share nothing.

    Each callable returns figures by name (e.g. p50 and p99); all return the same names.
    """
    mine = [ours()]
    rest: dict[str, list[dict[str, float]]] = {name: [] for name in others}
    for _ in rounds(pairs):
        for name, other in others.items():
            rest[name].append(other())
        mine.append(ours())
    return Pairs(mine[:-1], mine[1:], rest)


def rounds(most: int) -> Iterator[int]:
    """Counts to `most`, or as far as the time lasts, but `LEAST` times at least."""
    until = time.monotonic() + (BRIEF if os.environ.get(QUICK) else LONG)
    for count in range(most):
        if count >= LEAST and time.monotonic() > until:
            return
        yield count


def there_and_back(
    once: Callable[[int], object], frames: int, clock: Callable[[], int] = time.perf_counter_ns
) -> dict[str, float]:
    """Returns the median time of `once(i)`, us, as `p50`: through the frames and back, so that no frame leaps.

    `clock`: ns; `time.process_time_ns` for computations long enough that others take the processor meanwhile.
    """
    times = []
    for i in [*range(frames), *reversed(range(frames))]:
        start = clock()
        once(i)
        times.append((clock() - start) / 1e3)
    return {"p50": statistics.median(times)}


@dataclass(frozen=True)
class Pairs:
    """The results of `measure`."""

    first: list[dict[str, float]]
    again: list[dict[str, float]]
    others: dict[str, list[dict[str, float]]]

    def row(
        self,
        id: str,
        what: str,
        figure: str,
        other: str,
        unit: str,
        aim: str = "",
        holds: Callable[[float], bool] | None = None,
    ) -> Row:
        """Returns the comparison of one figure with one other; `holds` judges the ratio."""
        ours = [m[figure] for m in self.first]
        theirs = [m[figure] for m in self.others[other]]
        ratios = [a / b for a, b in zip(ours, theirs, strict=True) if b]
        controls = [a / m[figure] for a, m in zip(ours, self.again, strict=True) if m[figure]]
        ratio = statistics.median(ratios)
        control = round(statistics.median(controls), 3) if controls else None  # what is always 0 has none
        return Row(
            id=id, what=what, ours=round(statistics.median(ours), 3), other=round(statistics.median(theirs), 3),
            other_name=other,
            ratio=round(ratio, 3), control=control, unit=unit, aim=aim, holds=holds(ratio) if holds else None,
            interval=interval(ratios), control_interval=interval(controls) if controls else None, pairs=len(ours),
        )  # fmt: skip


def interval(ratios: list[float]) -> tuple[float, float]:
    """Returns between what the median of these lies, at 95 %: of medians of samples drawn anew from them."""
    drawn = np.random.default_rng(1).choice(ratios, (2000, len(ratios)))
    low, high = np.percentile(np.median(drawn, axis=1), (2.5, 97.5))
    return round(float(low), 3), round(float(high), 3)
