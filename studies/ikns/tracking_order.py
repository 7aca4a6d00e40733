"""Which trials a subject of the tracking experiment does, in which order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from srl.studies.ikns.curves import KINDS

NAME: Final = "ikns-tracking"
CONDITIONS: Final = ("ikns", "gamepad")
REPETITIONS: Final = 3
Entry = tuple[str, str, int]
"""Condition, curve, repetition from 1."""


def ordered(seed: Sequence[int], repetitions: int = REPETITIONS) -> Iterator[Entry]:
    """A random order: which condition comes first, and then the trials within each."""
    rng = np.random.default_rng(seed)
    plan = [(name, repetition) for name in KINDS for repetition in range(1, repetitions + 1)]
    for condition in rng.permutation(CONDITIONS).tolist():
        for at in rng.permutation(len(plan)).tolist():
            yield (condition, *plan[at])
