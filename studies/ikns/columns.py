"""Figures of a column of trials' values, for the lines of a study's table; NaN where there are no trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np


def mean(found: Sequence[Mapping[str, Any]], key: str) -> float:
    """The mean of the trials' values."""
    return float(np.mean([values[key] for values in found])) if found else float("nan")


def most(found: Sequence[Mapping[str, Any]], key: str) -> float:
    """The largest of the trials' values."""
    return float(np.max([values[key] for values in found])) if found else float("nan")
