"""One signal's place among the float64 words of a row, with all that a reader needs to know about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Field:
    """One signal's place in a row.

    Unit, frame, labels, slots, components, visual, links, groups and slides are as in
    `srl.runtime.contracts.signals.Signal`. Earlier recordings don't say which joints slide.

    Attributes:
        name: `<device or controller>.<signal>`.
        role: state, command (as the controller requested it), applied, sent, internal, parameter, setpoint or truth.
        offset: index of its first word among the float64 words.
        shape: the signal's shape.
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
    slots: bool = False
    components: tuple[tuple[str, ...], ...] = ()
    groups: tuple[str, ...] = ()
    slides: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of float64 words."""
        return int(np.prod(self.shape, dtype=int))
