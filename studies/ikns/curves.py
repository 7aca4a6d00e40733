"""The three curves of the tracking experiment: what the control value should be, over time.

Lisini Baldi et al. 2023, section III-B and Fig. 3: pseudo-random, smooth, with flat parts, 25 s; T1 is slower, T2 holds
rapid changes, one of them from 90 to about 30 in less than 3 s. The samples themselves aren't published: these are
ours, drawn once from a seed that was never changed. Moves are minimum-jerk, so rate and acceleration are continuous.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from srl.runtime.contracts.signals import Array

SECONDS: Final = 25.0
SETTLE: Final = 5.0
"""s before a curve in which the pointer is brought to its first value."""


@dataclass(frozen=True)
class Kind:
    """How a curve is drawn: s of a move and of a flat part, from and to; least and greatest step of a move."""

    seed: int
    move: tuple[float, float]
    flat: tuple[float, float]
    step: tuple[float, float]
    first: tuple[tuple[float, float, float], ...] = ()  # moves that are set: s of flat before it, s, value after it


KINDS: Final = {
    "T1": Kind(1, (3.5, 5.0), (0.5, 1.5), (0.15, 0.35)),
    "T2": Kind(2, (1.2, 2.4), (0.5, 1.5), (0.4, 0.7), ((1.5, 2.0, 0.9), (1.0, 2.6, 0.3))),
    "T3": Kind(3, (2.2, 3.4), (0.5, 1.5), (0.2, 0.5)),
}


def curve(name: str, t: ArrayLike) -> Array:
    """The curve T1, T2 or T3 at t (k,) s since its beginning; 0 to 1. Before and after it, its ends."""
    times, values = _knots(name)
    at = np.clip(np.asarray(t, dtype=float), times[0], times[-1])
    i = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    s = (at - times[i]) / (times[i + 1] - times[i])
    found: Array = values[i] + (values[i + 1] - values[i]) * s**3 * (10.0 + s * (6.0 * s - 15.0))
    return found


@cache
def _knots(name: str) -> tuple[Array, Array]:
    """Times (k,) s and values (k,) between which a move or a flat part runs."""
    kind = KINDS[name]
    rng = np.random.default_rng(kind.seed)
    times, values = [0.0], [0.5]
    planned = list(kind.first)
    while times[-1] < SECONDS:
        flat, move, value = rng.uniform(*kind.flat), rng.uniform(*kind.move), values[-1]
        if planned:
            flat, move, value = planned.pop(0)
        else:
            step = rng.uniform(*kind.step) * rng.choice((-1.0, 1.0))
            value = value + step if 0.05 <= value + step <= 0.95 else value - step
            value = float(np.clip(value, 0.05, 0.95))
        times += [times[-1] + flat, times[-1] + flat + move]
        values += [values[-1], value]
    return np.array(times), np.array(values)


def scores(t: Array, value: Array, name: str) -> dict[str, float]:
    """How well a control value (n,) at t (n,) s followed a curve: % of the greatest value."""
    error = 100.0 * (value - curve(name, t))
    return {
        "rmse": float(np.sqrt(np.mean(error**2))),
        "mean_error": float(np.mean(np.abs(error))),
        "worst_step": float(100.0 * np.abs(np.diff(value)).max(initial=0.0)),
    }
