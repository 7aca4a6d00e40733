"""The elements of a layout's signals by name, with a unit for each: what plots and other programs' files call them.

A name is the reference that plots use: `finger.position[mcp]`, `hand.tips[thumb,x]`; a signal of one unnamed number
is called as the signal. Rows without names (slots) have indices.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, QUATERNION, TWIST, WRENCH

# Of a unit for two quantities ("N, N m"), which one each name has.
_SECOND: Final = {
    WRENCH: WRENCH[3:],
    TWIST: TWIST[3:],
    PLANAR: PLANAR[2:],
    PLANAR_TWIST: PLANAR_TWIST[2:],
}
_SLIDING: Final = {"rad": "m", "rad/s": "m/s", "rad/s^2": "m/s^2", "N m": "N"}


@dataclass(frozen=True)
class Element:
    """One number of a signal.

    Attributes:
        name: its reference.
        parts: the name, or the index as text, along each axis.
        unit: its own.
    """

    name: str
    parts: tuple[str, ...]
    unit: str


def elements(field: Field) -> list[Element]:
    """A signal's elements in the order of its words."""
    axes = _axes(field)
    if not field.shape or (field.shape == (1,) and not field.labels):
        return [Element(field.name, ("0",) * len(field.shape), field.unit)]
    found = []
    for index, parts in zip(np.ndindex(field.shape), product(*axes), strict=True):
        found.append(Element(f"{field.name}[{','.join(parts)}]", parts, _unit(field, axes, index, parts)))
    return found


def _axes(field: Field) -> list[tuple[str, ...]]:
    """A name, or the index, for each place along each axis."""
    given = (field.labels, *field.components, *((),) * len(field.shape))
    return [
        names if len(names) == size else tuple(map(str, range(size)))
        for names, size in zip(given, field.shape, strict=False)
    ]


def _unit(field: Field, axes: list[tuple[str, ...]], index: tuple[int, ...], parts: tuple[str, ...]) -> str:
    first, comma, second = field.unit.partition(", ")
    if not comma:
        if any(part in QUATERNION for part in parts):
            return "1"
        return _SLIDING.get(field.unit, field.unit) if parts[0] in field.slides else field.unit
    for names, part in zip(axes, parts, strict=True):
        if names in _SECOND:
            return second if part in _SECOND[names] else first
    if "," in second:
        return field.unit  # more than two quantities: nobody says which is whose
    # An unnamed wrench or twist is three and three. Else the first is of the one quantity, the others of the other:
    # an arrow's point and force, a load's mass and place.
    split = 3 if not field.labels and field.shape[0] == 6 else 2 if not field.labels and field.shape[0] == 3 else 1
    return first if index[0] < split else second
