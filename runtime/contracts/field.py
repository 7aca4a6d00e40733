"""One signal's place among the float64 words of a row, with all that a reader needs to know of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Field:
    """See the module's text; unit, frame, labels, visual and links as in `runtime.contracts.signals.Signal`.

    Attributes:
        name: `<device or controller>.<signal>`.
        role: state, command (as the controller asked), applied, internal, parameter, setpoint or truth.
        offset: of its first word among the float64 words.
        shape: as the signal's.
    """

    name: str
    role: str
    offset: int
    shape: tuple[int, ...]
    unit: str
    frame: str | None = None
    labels: tuple[str, ...] = ()
    visual: str = ""
    links: tuple[tuple[int, ...], ...] = ()

    @property
    def size(self) -> int:
        """Number of float64 words."""
        return int(np.prod(self.shape, dtype=int))
