"""What a stream's samples become in the states: newest values, blocks, and the count that shows gaps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from srl.drivers.lsl.config import LslConfig
from srl.drivers.lsl.match import Picked
from srl.runtime.contracts.signals import Array


class Taken(NamedTuple):
    """What was made of samples.

    Attributes:
        good: which of them (k,) were taken.
        problem: why the newest one wasn't; "" if it was.
    """

    good: np.ndarray
    problem: str


class Rows:
    """Fills the states of a device."""

    def __init__(self, config: LslConfig, picked: Mapping[str, Picked]) -> None:
        """`picked`: each signal's channels."""
        self._signals, self._picked = config.signals, picked
        self._longest = max(entry.block for entry in config.signals.values())

    def take(self, state: Mapping[str, Array], values: Array, timely: np.ndarray, gap: bool) -> Taken:
        """Takes samples (k, channels), k > 0, oldest first.

        Args:
            state: the device's arrays.
            values: as sent.
            timely: (k,), which of them have a stamp that can be.
            gap: they don't follow those before.
        """
        good, problem = timely.copy(), ""
        for name, picked in self._picked.items():
            if self._signals[name].nan:
                continue
            finite = np.isfinite(values[:, picked.columns])
            good &= finite.all(axis=1)
            if not finite[-1].all():
                lacking = np.array(list(self._signals[name].channels))[~finite[-1]]
                problem = f"no number (NaN) in {name}: {', '.join(lacking)}"
        if not timely[-1]:
            problem = "its stamps are of the future: the clocks' offset is wrong"
        if "count" in state:
            # More than any block holds: whoever counts sees that samples are missing.
            state["count"][0] += len(values) + (self._longest if gap or not good.all() else 0)
        if good.any():
            self._fill(state, values[good])
        return Taken(good, problem)

    def _fill(self, state: Mapping[str, Array], values: Array) -> None:
        for name, picked in self._picked.items():
            block = self._signals[name].block
            new = values[-max(block, 1) :, picked.columns] * picked.factors
            if block:
                kept = state[name]
                kept[: block - len(new)] = kept[len(new) :].copy()
                kept[block - len(new) :] = new
            else:
                state[name][:] = new[-1]
