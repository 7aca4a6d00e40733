"""Of one link of a URDF: its inertia, whether that can be, and its contact shapes."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots.description import Capsule, Inertial
from srl.runtime.models.robots.urdf import numbers

Warning = str
_DENSEST: Final = 22600.0  # kg/m^3, osmium: no body of a mass has less inertia than a sphere of it
_ROUNDED: Final = 0.01  # share by which a file's rounding may miss the triangle inequality
_HEAVY: Final = 150.0  # kg
_LEAST: Final = 0.1  # m, of a link whose size nobody knows
_WIDE: Final = 1.5  # times a link's size; a rod's radius of gyration is 0.29 of its length
_MOMENTS: Final = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def inertial(link: Element, file: Path, ends: Sequence[Array], warnings: list[Warning]) -> Inertial | None:
    """The inertia in the link's frame; None: it has none.

    Args:
        ends: (3,) m each, where joints begin on it, by which its size is judged.
        warnings: what is probably wrong is added.
    Raises:
        OptionError: no body has such an inertia.
    """
    name, found = link.get("name"), link.find("inertial")
    if found is None:
        return None
    place = f"{file}: link {name}"
    given = found.find("mass"), found.find("inertia")
    (mass,) = numbers(given[0].get("value") if given[0] is not None else None, 1, (0.0,), f"{place}: mass", inf)
    moments = tuple(
        numbers(given[1].get(key) if given[1] is not None else None, 1, (0.0,), f"{place}: {key}", inf)[0]
        for key in _MOMENTS
    )
    remedy = "Correct the <inertial> of the URDF: kg, m, kg m^2, about the centre of mass"
    if mass < 0.0 or (mass == 0.0 and any(moments)):
        raise OptionError(f"{place}: a mass of {mass:g} kg with the inertia {moments} can't be", remedy)
    if mass == 0.0:
        return None
    turn, com = _origin(found, place)
    xx, yy, zz, xy, xz, yz = moments
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    sizes, axes = np.linalg.eigh(own)
    a, b, c = sizes.tolist()
    total = a + b + c
    if (c > 0.0 and a < -1e-9 * c) or c < 0.0:
        problem = f"{place}: its inertia is not positive definite: principal moments {a:.4g}, {b:.4g}, {c:.4g}"
        raise OptionError(problem, remedy)
    if a + b < c * (1.0 - _ROUNDED):
        problem = f"{place}: principal moments {a:.4g}, {b:.4g}, {c:.4g} can't be: none is more than the others' sum"
        raise OptionError(problem, remedy)
    if a + b <= c and c > 0.0:
        lacking = (c - a - b) / 2 + 1e-9 * c
        own = axes @ np.diag([a + lacking, b + lacking, c]) @ axes.T
    warnings += _warned(str(name), mass, com, total, c, [*ends, com])
    return Inertial(mass, com, turn @ own @ turn.T)


def _warned(name: str, mass: float, com: Array, total: float, most: float, ends: Sequence[Array]) -> list[Warning]:
    found = []
    if mass > _HEAVY:
        found.append(f"link {name} has {mass:g} kg. Are these grams? {mass:g} g are {mass / 1000:g} kg")
    if np.linalg.norm(com) > 3.0:
        found.append(f"link {name}: its centre of mass is {np.linalg.norm(com):.4g} m away. Are these millimetres?")
    radius = (3.0 * mass / (4.0 * np.pi * _DENSEST)) ** (1.0 / 3.0)
    if total < 1.2 * mass * radius**2:
        found.append(f"link {name}: {mass:g} kg have at least the inertia {0.4 * mass * radius**2:.2g} kg m^2, "
                     f"even as a ball of osmium, and it has {total / 3:.2g}")  # fmt: skip
    size = max(_LEAST, *(float(np.linalg.norm(end)) for end in ends))
    gyration = (most / mass) ** 0.5
    if gyration > _WIDE * size:
        found.append(
            f"link {name}: {mass:g} kg with {most:.3g} kg m^2 would be {gyration:.3g} m from its axis, and the link is "
            f"about {size:.3g} m long. Is the inertia in other units?"
        )
    return found


def collision_shapes(link: Element, file: Path) -> tuple[tuple[Capsule, ...], bool]:
    """Capsules round the link's contact shapes, in its frame; and whether they are all of them: meshes aren't read."""
    made, whole = [], True
    for shape in link.findall("collision"):
        place = f"{file}: link {link.get('name')}: collision"
        turn, middle = _origin(shape, place)
        geometry = shape.find("geometry")
        kind = geometry[0] if geometry is not None and len(geometry) else None
        found = _segment(kind, place) if kind is not None else None
        if found is None:
            whole = False
            continue
        axis, half, radius = found
        way = turn[:, axis] * half
        start, end = ((x, y, z) for x, y, z in ((middle - way).tolist(), (middle + way).tolist()))
        made.append(Capsule(start, end, radius))
    return tuple(made), whole


def _segment(shape: Element, place: str) -> tuple[int, float, float] | None:
    """Axis (0 to 2), half length and radius, m, of a capsule that holds a shape; None for a mesh."""
    if shape.tag == "box":
        half = np.array(numbers(shape.get("size"), 3, (0.0, 0.0, 0.0), place)) / 2
        axis = int(np.argmax(half))
        return axis, float(half[axis]), float(np.hypot(*np.delete(half, axis)))
    if shape.tag not in ("cylinder", "sphere", "capsule"):
        return None
    (radius,) = numbers(shape.get("radius"), 1, (0.0,), place)
    (length,) = numbers(shape.get("length"), 1, (0.0,), place)
    return 2, length / 2, radius


def _origin(element: Element, place: str) -> tuple[Array, Array]:
    """Rotation (3, 3) and place (3,) m of an element's <origin>."""
    origin = element.find("origin")
    xyz, rpy = (
        numbers(origin.get(key) if origin is not None else None, 3, (0.0, 0.0, 0.0), place) for key in ("xyz", "rpy")
    )
    return np.array(rotation.matrix(rotation.from_rpy(rpy[0], rpy[1], rpy[2]))), np.array(xyz)
