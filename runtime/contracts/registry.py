"""Looks parts up by name from entry points, so that another package can add a device or a control law.

A part is imported only when a profile uses it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from srl.runtime.contracts import extras
from srl.runtime.contracts.declared import declared
from srl.runtime.contracts.errors import HostError, MissingError, nearest


def names(group: str) -> list[str]:
    """The registered names of a group ("drivers", "controllers", "worlds", "parts", "calibrations"), sorted."""
    return sorted(_points(group, tuple(sys.path)))


def load(group: str, name: str, place: str) -> Any:
    """The class registered as `name`.

    Args:
        group: as in `names`.
        name: as a profile writes it.
        place: the profile's key path, for the error.
    Raises:
        MissingError: no part has that name.
        HostError: the part is registered but its import fails, or two packages claim the name.
    """
    points = _points(group, tuple(sys.path))
    if name not in points:
        raise MissingError(place, f"no {_one(group)} is called '{name}'", nearest(name, points))
    point, *others = points[name]
    if others:
        problem = f"'{name}' is claimed twice, by {point.value} and {others[0].value}"
        raise HostError(f"entry points srl.{group}", problem, "Uninstall one of the two packages")
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise HostError(
            place, f"{_one(group)} '{name}' ({point.value}) can't be imported: {error}", extras.import_remedy(error)
        ) from error


def describe(group: str, name: str, attributes: Sequence[str]) -> dict[str, Any]:
    """What the class registered as `name` says of itself: class attributes by name.

    They are read from its source, which is much quicker than an import; where that doesn't tell, it is imported.

    Raises:
        SrlError: as from `load`.
    """
    place = f"{_one(group)} {name}"
    points = _points(group, tuple(sys.path)).get(name, [])
    described = declared(points[0].value, attributes) if len(points) == 1 else None
    if described is None:
        part = load(group, name, place)
        described = {attribute: getattr(part, attribute) for attribute in attributes}
    return described


def _one(group: str) -> str:
    return "study" if group == "studies" else group.removesuffix("s")


@cache  # it reads the metadata of all installed packages, and a profile asks for parts of seven groups
def _all_points(path: tuple[str, ...]) -> Any:
    """The entry points of all groups, as they are with this `sys.path`."""
    return entry_points()


@cache
def _points(group: str, path: tuple[str, ...]) -> dict[str, list[EntryPoint]]:
    """The entry points of a group by name, as they are with this `sys.path`; several that differ: a name of two."""
    found: dict[str, list[EntryPoint]] = {}
    for point in _all_points(path).select(group=f"srl.{group}"):
        own = found.setdefault(point.name, [])
        if all(other.value != point.value for other in own):
            own.append(point)
    return found
