"""EMG samples of successive cycles: each row has the newest `block` of them, and how many there have been.

A row that brings more new samples than a block holds, or fewer than the row before, is a gap: no filter may run across.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.control.emg.processing import Filters, OnlineEnvelope
from srl.runtime.contracts.signals import Array

# Equal samples of one muscle in succession: no electrode gives them, a sensor that is out of reach, hangs or is at its
# end does.
GONE: Final = 20


class Stream:
    """The causal envelope of a stream that comes in rows.

    Attributes:
        fresh: whether the newest `take` brought samples that follow those before.
        settled: whether so many have followed each other that the filters have forgotten how they began.
        settles: s, that this takes.
    """

    def __init__(self, muscles: int, filters: Filters, stuck: bool = True) -> None:
        """`stuck`: equal samples of any value are missing, else zeros alone: a calibration says itself what is dead."""
        self._any = stuck
        self._muscles, self._filters = muscles, filters
        self._least = round(filters.rate / filters.cutoff)
        self.settles = 1.0 / filters.cutoff
        self.forget()

    def forget(self) -> None:
        """Begins anew, as after a gap."""
        self._online, self._count, self._seen = OnlineEnvelope(self._muscles, self._filters), np.nan, 0
        self.fresh = self.settled = False

    def take(self, block: Array, count: float) -> Array | None:
        """The envelopes (m, n) of a row's m new samples, which may be 0; None: they don't follow those before.

        Args:
            block: (k, n) V, the newest k samples, oldest first.
            count: how many there have been.
        """
        new = count - self._count
        self.fresh = False
        there = np.isfinite(count) and bool(np.isfinite(block).all())
        if not there or self._stands(block) or not 0 <= new <= len(block):
            self.forget()
            self._count = count if there else np.nan
            return None
        self._count = count
        if new == 0:
            return np.empty((0, self._muscles))
        found = self._online.take(block[len(block) - int(new) :])
        self._seen += int(new)
        self.fresh, self.settled = True, self._seen >= self._least
        return found

    def _stands(self, block: Array) -> bool:
        """Whether a muscle's newest samples are all alike."""
        newest = block[-GONE:]
        return len(newest) == GONE and bool((newest == (newest[-1] if self._any else 0.0)).all(axis=0).any())


def joined_samples(blocks: Array, counts: Array) -> Array | None:
    """The samples (m, n) V that came with rows, but the first row's; None: some are missing.

    Args:
        blocks: (T, k, n) V.
        counts: (T,) how many there have been.
    """
    if len(blocks) < 2 or not (np.isfinite(counts).all() and np.isfinite(blocks).all()):
        return None
    new, k = np.diff(counts), blocks.shape[1]
    if (new < 0).any() or (new > k).any():
        return None
    parts = [block[k - int(m) :] for block, m in zip(blocks[1:], new, strict=True)]
    found: Array = np.concatenate(parts)
    return found if len(found) else None
