"""From a world whose y axis is up to one whose z axis is."""

from __future__ import annotations

from collections.abc import Sequence

from srl.runtime.contracts.rotation import Quaternion


def z_up_point(p: Sequence[float]) -> tuple[float, float, float]:
    """Converts a point of a y-up world (x forward, y up, z right) to x forward, y left, z up."""
    return p[0], -p[2], p[1]


def z_up_quaternion(q: Quaternion) -> Quaternion:
    """Converts a rotation likewise: world and body axes are renamed alike, so an unrotated body stays unrotated."""
    w, x, y, z = q
    return w, x, -z, y
