"""Other labellings of an arm's points, and whether a body fits better by one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.models.body import SIDES, Marker, Side

_BETTER: Final = 0.7  # of the residual, with which other labels fit better
OTHER: Final = 0.2  # rad, by which a posture is another

Labelling = tuple[Side, NDArray[np.intp]]
"""An arm's side, and the places (k,) whose points are taken."""


def fits_better(one: tuple[int, float, float], other: tuple[int, float, float]) -> bool:
    """Whether one fit (markers left out, residual, excess) is better than another."""
    if one[0] != other[0]:
        return one[0] < other[0]
    return one[1] < _BETTER * other[1] or (one[1] < other[1] / _BETTER and one[2] + OTHER < other[2])


def labellings(markers: Mapping[str, Marker]) -> list[Labelling]:
    """Ways to read the points (k,) of markers whose labels were exchanged: two of an arm, or three of one hand."""
    names = list(markers)
    found = []
    for side in SIDES:
        arm = [i for i, name in enumerate(names) if markers[name].segment.startswith(f"{side}_")]
        hand = [i for i in arm if markers[names[i]].segment in (f"{side}_forearm", f"{side}_hand")]
        cycles = [c for three in combinations(hand, 3) for c in (three, three[::-1])]
        for places in [*cycles, *combinations(arm, 2)]:
            order = np.arange(len(names))
            order[list(places)] = [*places[1:], places[0]]
            found.append((side, order))
    return found


def ways(known: Sequence[Labelling], which: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], Side | None]]:
    """Those of `known` that concern any of the markers `which` (k,), each with the forearm as it is and turned over."""
    at = np.flatnonzero(which)
    found = [(side, order) for side, order in known if (order[at] != at).any()]
    return [(order, over) for side, order in found for over in (None, side)]
