"""When an action counts as meant: how near to it the motion must be, and for how long.

A motion triggers an action where its squared distance stays within the ratio `limits` to the class's limit for `dwell`.
Both are chosen on what was held out. An action must trigger itself: else it is missed. An action that the recogniser
doesn't know must trigger nothing: each action is taken for unknown in turn, by leaving its class out of the comparison.
The candidates are compared by the share of trials that are missed, plus `cost` times the share of those that trigger
another action. The wearer's own everyday motion must trigger nothing at all: the limit of each action is lowered until
none of it does, with a margin.

The idea of judging a recogniser on classes that it hasn't seen is Scheirer's: Scheirer, Rocha, Sapkota, Boult, Toward
open set recognition, IEEE TPAMI 35(7), 2013. That the everyday motion of the sample triggers nothing is by
construction and says nothing by itself. Each limit that it sets is the least of a sample's: with r of them the rate of
a Poisson process on other motion of the same kind is Gamma distributed with shape r over the sample's time (Wilks 1941
for r = 1). `alarms` is its upper end at 95 %, and for r = 0 that of r = 1; `slack` beyond the sample isn't counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, exp
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.control.intention.discriminant import Discriminant, posterior
from srl.control.intention.features import RATE
from srl.runtime.contracts.signals import Array

DWELLS: Final = (0.3, 0.6, 1.0)  # s that are tried
RATIOS: Final = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.3)  # to the limit, that are tried


@dataclass(frozen=True)
class Triggers:
    """k actions.

    Attributes:
        dwell: s for which an action must be seen.
        limits: (k,) ratio of squared distance to the class's limit, within which a motion must be.
        missed: share of held-out trials that don't trigger their action.
        unknown: share of them that trigger another action if theirs is unknown.
        everyday: s of everyday motion that triggers nothing.
        lowered: number of limits that everyday motion set.
    """

    dwell: float
    limits: Array
    missed: float
    unknown: float
    everyday: float
    lowered: int = 0

    @property
    def alarms(self) -> float:
        """False activations a minute that other everyday motion may give: upper end of the one-sided 95 % interval."""
        return 60.0 * _upper(max(self.lowered, 1)) / self.everyday if self.everyday > 0.0 else float("inf")


def _upper(shape: int) -> float:
    """What a Gamma distribution of this shape exceeds in 5 % of all cases; by halving."""
    low, high = 0.0, 10.0 + 5.0 * shape
    for _ in range(60):
        x = 0.5 * (low + high)
        term, total = 1.0, 1.0
        for k in range(1, shape):
            term *= x / k
            total += term
        low, high = (x, high) if exp(-x) * total > 0.05 else (low, x)
    return low


def looks(found: Discriminant, distances: Array, confidence: float) -> tuple[NDArray[np.intp], Array]:
    """Per window the nearest class, and its squared distance over the class's limit; infinite where it isn't sure.

    Args:
        found: with limits and temperature.
        distances: (T, m), squared.
        confidence: least posterior that counts.
    """
    best = distances.argmin(axis=1)
    sure = posterior(distances, found.temperature).max(axis=1) >= confidence
    return best, np.where(sure, distances.min(axis=1) / found.limits[best], np.inf)


def least(found: Discriminant, distances: Array, k: int, confidence: float, dwell: float) -> Array:
    """(k,): the ratio to the limit at which each action would just trigger in a motion; infinite if it never would.

    Args:
        found: with limits and temperature.
        distances: (T, m), squared; the first k classes are the actions.
        k: number of actions.
        confidence: least posterior that counts.
        dwell: s.
    """
    length = max(ceil(dwell * RATE - 1e-9), 1)
    lowest = np.full(k, np.inf)
    if len(distances) < length:
        return lowest
    best, ratio = looks(found, distances, confidence)
    for action in np.unique(best[best < k]).tolist():
        own = np.where(best == action, ratio, np.inf)
        runs = np.lib.stride_tricks.sliding_window_view(own, length)
        lowest[action] = runs.max(axis=1).min()
    return lowest


def choose(
    found: Discriminant,
    k: int,
    trials: Sequence[tuple[int, Array]],
    everyday: Sequence[Array],
    *,
    confidence: float,
    cost: float,
    slack: float,
    dwells: Sequence[float] = DWELLS,
    ratios: Sequence[float] = RATIOS,
) -> Triggers:
    """Chooses among `dwells` and `ratios`; see the module's text. Of equals the shortest dwell, then the widest limit.

    Args:
        found: with limits and temperature.
        k: number of actions.
        trials: class and squared distances (T, m) of what was held out.
        everyday: squared distances (T, m) of the wearer's everyday motion.
        confidence: least posterior that counts.
        cost: of a trial that triggers another action, in missed ones.
        slack: by which everyday motion stays beyond the limits.
        dwells, ratios: the candidates.
    """
    own = [(kind, distances) for kind, distances in trials if kind < k]
    blind = [(kind, np.where(np.arange(distances.shape[1]) == kind, np.inf, distances)) for kind, distances in own]
    kinds = np.array([kind for kind, _ in own])
    rows = np.arange(len(own))
    best: tuple[float, Triggers] | None = None
    for dwell in sorted(dwells):
        hits = np.array([least(found, distances, k, confidence, dwell) for _, distances in own])
        others = np.array([least(found, distances, k, confidence, dwell) for _, distances in blind])
        reached = [least(found, distances, k, confidence, dwell) for distances in everyday]
        most = np.min(reached, axis=0) / slack if reached else np.full(k, np.inf)
        for ratio in sorted(ratios, reverse=True):
            limits = np.minimum(ratio, most)
            missed = float((hits[rows, kinds] > limits[kinds]).mean())
            unknown = float((others <= limits).any(axis=1).mean())
            score = missed + cost * unknown
            if best is None or score < best[0] - 1e-9:
                seconds = sum(len(distances) for distances in everyday) / RATE
                best = score, Triggers(dwell, limits, missed, unknown, seconds, int((most < ratio).sum()))
    assert best is not None
    return best[1]
