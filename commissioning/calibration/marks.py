"""The law that marks in each row of a calibration what the person was to do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.controller import Controller, Parameter

Indices = NDArray[np.intp]


def stretch_of(marks: Indices, mark: int) -> slice:
    """The last samples without a break that have this mark, among (T,); empty if there are none."""
    found = np.flatnonzero(marks == mark)
    if not len(found):
        return slice(0, 0)
    breaks = np.flatnonzero(np.diff(found) > 1)
    return slice(int(found[breaks[-1] + 1 if len(breaks) else 0]), int(found[-1]) + 1)


class MarkLaw(Controller):
    """Computes nothing. Its parameter `mark` says in every row what is to be done; its options, what is where."""

    def marks(self, most: int) -> None:
        """Declares the parameter; `most`: the greatest mark."""
        self.parameters = (
            Parameter(name="mark", default=0.0, lower=0.0, upper=float(most), unit="1", text="what is to be done"),
        )

    def reset(self) -> None:
        """Nothing begins."""

    def update(self, dt: float) -> None:
        """Nothing is computed."""
