"""Muscle activity of a trial, from surface EMG. The processing is the runtime's own (`srl.control.emg.processing`).

The paper says only that signals were filtered and normalised. The band and the cut-off here are usual for surface EMG,
and are stated with every result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from srl.control.emg.processing import (
    PLACE,
    EmgError,
    Filters,
    OnlineEnvelope,
    checked,
    envelope,
    greatest,
    normalise,
)
from srl.runtime.contracts.signals import Array
from srl.studies.toolkit.errors import StudyError

__all__ = [
    "MUSCLES",
    "PLACE",
    "Activity",
    "EmgError",
    "Filters",
    "OnlineEnvelope",
    "activity",
    "envelope",
    "greatest",
    "normalise",
]

# The paper's four muscles: recommended names for the trigno driver's channels, and the paper's letters.
MUSCLES: Final = {"deltoid_anterior": "AD", "deltoid_posterior": "PD", "biceps": "BC", "triceps": "TR"}
_LEVELS: Final = (10, 50, 90)  # per cent of the time


@dataclass(frozen=True)
class Activity:
    """A trial's muscle activity, each (n,), shares of the MVC.

    Attributes:
        muscles: their names.
        seconds: evaluated length of the trial.
        mean: over the trial, as in the paper's Figs. 7 and 10.
        static, median, peak: the levels not exceeded in 10, 50 and 90 per cent of the time.
        above: the share of the time above the MVC; more than a little means that the MVC trial was weak.
    """

    muscles: tuple[str, ...]
    seconds: float
    mean: Array
    static: Array
    median: Array
    peak: Array
    above: Array


def activity(normal: ArrayLike, muscles: Sequence[str], rate: float) -> Activity:
    """Computes a trial's figures from its normalised envelope (k, n); raises StudyError if names don't match."""
    found = checked(normal)
    if len(muscles) != found.shape[1] or len(set(muscles)) < len(muscles):
        problem = f"the names {', '.join(muscles)} for {found.shape[1]} muscles"
        raise StudyError(PLACE, problem, "Give each muscle a name of its own")
    static, median, peak = np.percentile(found, _LEVELS, axis=0)
    above = (found > 1.0).mean(axis=0)
    return Activity(tuple(muscles), len(found) / rate, found.mean(axis=0), static, median, peak, above)
