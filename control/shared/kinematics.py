"""A serial chain in standard Denavit-Hartenberg form: forward kinematics and geometric Jacobian.

It uses plain numbers: for a chain this short, a call of numpy costs more than its arithmetic.
"""

from __future__ import annotations

from math import cos, sin
from typing import cast

from srl.control.shared.symmetric import Vector
from srl.runtime.contracts.signals import Array


class Chain:
    """A chain of n revolute joints: T_j = RotZ(q_j) TransX(a_j) RotX(alpha_j), with d = 0."""

    def __init__(self, base: Array, rows: Array) -> None:
        """Args:
        base: (4, 4), the base in the common frame, m.
        rows: (n, 2), alpha (rad) and a (m) of each row.
        """
        self.base = cast(list[Vector], [tuple(column) for column in base[:3].T.tolist()])
        self.rows = [(cos(alpha), sin(alpha), a) for alpha, a in rows.tolist()]
        self.points: list[Vector] = []
        """The base, then each row's end (n + 1), m, from the last call of `forward`."""
        self._axes: list[Vector] = []

    def forward(self, q: list[float]) -> Vector:
        """Returns the tip, m, for joint angles q (n,), rad."""
        (xx, xy, xz), (yx, yy, yz), z, o = self.base
        ox, oy, oz = o
        points, axes, turn = [o], [], 0.0
        for angle, (ca, sa, a) in zip(q, self.rows, strict=True):
            axes.append(z)
            # For parallel axes, x and y stay those of the first axis, and the angles are added.
            turn += angle
            c, s = cos(turn), sin(turn)
            ux, uy, uz = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
            if a:
                ox, oy, oz = ox + a * ux, oy + a * uy, oz + a * uz
            points.append((ox, oy, oz))
            if sa:
                vx, vy, vz = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
                zx, zy, zz = z
                z = (ca * zx - sa * vx, ca * zy - sa * vy, ca * zz - sa * vz)
                xx, xy, xz = ux, uy, uz
                yx, yy, yz = ca * vx + sa * zx, ca * vy + sa * zy, ca * vz + sa * zz
                turn = 0.0
        self.points, self._axes = points, axes
        return points[-1]

    def jacobian(self) -> list[Vector]:
        """Returns the n columns, m/rad: z x (tip - o) with axis z and origin o before each row, at the last q."""
        x, y, z = self.points[-1]
        columns = []
        for (ax, ay, az), (ox, oy, oz) in zip(self._axes, self.points, strict=False):
            dx, dy, dz = x - ox, y - oy, z - oz
            columns.append((ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx))
        return columns
