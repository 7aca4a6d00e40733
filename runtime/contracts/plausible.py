"""What a measured value can be: the plausible range of each signal, from its unit, its quantity and its device.

A value outside its range is no measurement, however well its frame was received. NaN and infinity pass: they say that
a value isn't known, and nothing takes them for one. The ranges are wide: they are bounds of what exists, not of what is
usual. A driver that knows its device better gives its own with `Signal.plausible`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSE, QUATERNION, TWIST, WRENCH

# By the labels of a row, or the components of each: each element's bound, in its own unit.
_BY_NAMES: Final[dict[tuple[str, ...], tuple[float, ...]]] = {
    POSE: (1e4,) * 3 + (1.01,) * 4,
    QUATERNION: (1.01,) * 4,
    TWIST: (20.0,) * 3 + (200.0,) * 3,
    WRENCH: (1e4,) * 3 + (1e3,) * 3,
    PLANAR: (1e5, 1e5, 1e4),
    PLANAR_TWIST: (10.0, 10.0, 20.0),
}
_BY_UNIT: Final[dict[str, tuple[float, float]]] = {
    "m": (-1e4, 1e4),  # who wears an inertial suit may walk far
    "rad": (-1e4, 1e4),  # 1600 turns of a joint that counts them
    "m/s": (-20.0, 20.0),
    "rad/s": (-1e3, 1e3),
    "m/s^2": (-4e3, 4e3),  # 400 g
    "N": (-1e4, 1e4),
    "N m": (-2e3, 2e3),
    "V": (-1e3, 1e3),
    "A": (-1e3, 1e3),
    "degC": (-100.0, 300.0),
}
_ANY: Final = (-1e9, 1e9)  # pure numbers, counts, and units that nobody knows here


def plausible(signal: Signal) -> tuple[Array, Array]:
    """The least and the greatest value that each element can have, (size,) each, in the signal's unit."""
    if signal.plausible is not None:
        least, most = (np.broadcast_to(np.asarray(v, np.float64), signal.shape).ravel() for v in signal.plausible)
        return least, most
    for names in (signal.labels, *signal.components[-1:]):
        if (bound := _BY_NAMES.get(names)) is not None:
            of = np.array(bound) if signal.shape[-1] == len(names) else np.array(bound)[:, None]
            ends: Array = np.broadcast_to(of, signal.shape).ravel()
            return -ends, ends
    low, high = _BY_UNIT.get(signal.unit, _ANY)
    return np.full(signal.size, low), np.full(signal.size, high)
