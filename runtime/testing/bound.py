"""Gives a driver or a controller arrays of its own, as the runtime does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar, overload

import numpy as np

from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.frames import IDENTITY

D = TypeVar("D", bound=Driver)
C = TypeVar("C", bound=Controller)


@overload
def bound(part: D) -> D: ...
@overload
def bound(part: C, transforms: Mapping[str, Sequence[float]] | None = None) -> C: ...
def bound(part: Driver | Controller, transforms: Mapping[str, Sequence[float]] | None = None) -> Driver | Controller:
    """Returns the driver or controller bound to its own arrays: zeros, and the parameters' defaults.

    Every output of a controller counts as wired to a device, so `applied` has an array for it.

    Args:
        transforms: a controller's, by name: x y z (m), w x y z; the others are the identity.
    """
    if isinstance(part, Driver):
        part.bind({s.name: np.zeros(s.shape) for s in part.states}, {c.name: np.zeros(c.shape) for c in part.commands})
    else:
        part.bind(
            {s.name: np.zeros(s.shape) for s in part.inputs},
            {s.name: np.zeros(s.shape) for s in part.outputs},
            {s.name: np.zeros(s.shape) for s in part.outputs},
            {p.name: np.array(p.default) for p in part.parameters},
            {t.name: np.array((transforms or {}).get(t.name, IDENTITY), float) for t in part.transforms},
        )
    return part
