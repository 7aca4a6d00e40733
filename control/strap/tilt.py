"""Roll and pitch of a base, from where up is. Yaw doesn't enter: gravity says nothing about it."""

from __future__ import annotations

from math import atan2, pi, sqrt

from srl.runtime.contracts.rotation import Quaternion, Vector, conjugate, product, turned

UP_Z: Vector = (0.0, 0.0, 1.0)  # of an inertial sensor's reference
UP_Y: Vector = (0.0, 1.0, 0.0)  # of a capture suit's world


def up_in(mount: Quaternion, orientation: Quaternion, up: Vector) -> Vector:
    """Where up is, in the frame in which a sensor has the rotation `mount`.

    Args:
        orientation: the sensor in its reference.
        up: in that reference.
    """
    return turned(product(mount, conjugate(orientation)), up)


def tilt(base: Vector, rigid: Vector) -> Vector:
    """The smallest rotation, as a rotation vector (rad), of the base from where a rigid one would be.

    Args:
        base: where up is in the base's axes, a unit vector.
        rigid: where it would be in the axes of a rigid base.
    Returns:
        t with R(t) base = rigid: R(t) has the base's axes in the rigid one's for columns, but for the yaw.
    """
    (ax, ay, az), (bx, by, bz) = base, rigid
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = sqrt(cx * cx + cy * cy + cz * cz)
    along = ax * bx + ay * by + az * bz
    if size < 1e-12:
        return (0.0, 0.0, 0.0) if along > 0.0 else (pi, 0.0, 0.0)  # upside down has no smallest: one as far
    angle = atan2(size, along) / size
    return (angle * cx, angle * cy, angle * cz)
