"""The fixed names of what lives in space: the elements of poses, twists and wrenches, in the runtime's order."""

from __future__ import annotations

from typing import Final

POINT: Final = ("x", "y", "z")  # m
QUATERNION: Final = ("qw", "qx", "qy", "qz")
POSE: Final = (*POINT, *QUATERNION)
TWIST: Final = ("vx", "vy", "vz", "wx", "wy", "wz")  # m/s, rad/s
FORCE: Final = ("fx", "fy", "fz")  # N
WRENCH: Final = (*FORCE, "tx", "ty", "tz")  # N, N m
PLANAR: Final = ("x", "y", "yaw")  # m, rad
PLANAR_TWIST: Final = ("vx", "vy", "wz")  # m/s, rad/s
POSITION_OF: Final = dict(zip(PLANAR_TWIST, PLANAR, strict=True))  # what each of these is the rate of
_ENDS: Final = ("x0", "y0", "z0", "x1", "y1", "z1")  # m
CAPSULE: Final = (*_ENDS, "radius", "distance")  # its axis' ends; m to the nearest body that matters, NaN: not known
GAP: Final = (*_ENDS, "distance")  # the nearest points of two bodies; m, negative where they overlap
