"""Recursive least squares of a rigid load's mass and first moment from wrench, gravity and acceleration.

In axes fixed to the tool, with the load's mass m, its first moment h = m c about the tool's origin, gravity less the
origin's acceleration g = g_0 - a, angular velocity w and angular acceleration z, the load pulls with

    F = m g - z x h - w x (w x h),      N = c x F = h x (g - z x c - w x (w x c))

(Newton and Euler; Atkeson, An and Hollerbach, IJRR 1986). The inertia about the centre of mass is left out: at the
accelerations of a robot that people touch, its part of the wrench is less than the sensor's error (Nadeau, Giamou and
Kelly, arXiv 2203.00830). With the c found so far in N, both are linear in (m, h), and the estimate is a Kalman filter
for these four constants: recursive least squares, to which a variance may be added while the load is still coming in.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Final

import numpy as np

from srl.control.cobot.contact_wrench import cross, square
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.signals import Array

Vector = tuple[float, float, float]

_CORRELATED: Final = 0.05  # s for which the errors of a wrench last: samples that are closer count as one
_UNKNOWN: Final = 0.3  # m, standard deviation of a centre of mass before anything was measured
_LEAST: Final = 0.05  # kg, below which there is no centre of mass


class Motion:
    """The tool's motion at an instant, in its own axes.

    Attributes:
        g: (3,) m/s^2, gravity less the acceleration of the tool's origin.
        w: (3,) rad/s, angular velocity.
        z: (3,) rad/s^2, angular acceleration.
        speed: m/s, of the tool's origin.
    """

    __slots__ = ("g", "speed", "w", "z")

    def __init__(self, g: Vector, w: Vector, z: Vector, speed: float = 0.0) -> None:
        self.g, self.w, self.z, self.speed = g, w, z, speed


class LoadEstimate:
    """Estimates a load; see the module's docstring.

    Attributes:
        mass: kg, from 0 to `heaviest`.
        moment: h (3,) kg m, about the tool's origin, its axes; at most `reach` times the mass.
        covariance: (4, 4) of (m, h), kg and kg m.
    """

    def __init__(
        self, heaviest: float, reach: float, noise: tuple[float, float], offset: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Args:
        heaviest: kg, of any load.
        reach: m, greatest distance of the centre of mass from the tool's origin.
        noise: N and N m, standard deviations of the wrench's errors.
        offset: N and N m, likewise of what it may be off all the time, which no further sample improves.
        """
        self.heaviest, self.reach = heaviest, reach
        self._variances = np.repeat(np.square(noise), 3) * _CORRELATED  # N^2 s, N^2 m^2 s
        self._spread = self._variances[[0, 3, 3, 3]] / GRAVITY**2  # kg^2 s, kg^2 m^2 s: of a weight seen for a second
        self._offset = (offset[0] / GRAVITY) ** 2, (offset[1] / GRAVITY) ** 2  # kg^2, kg^2 m^2
        self._regressor: Array = np.zeros((6, 4))
        self.reset()

    def reset(self) -> None:
        """Forgets the load: there is none, and nothing is known of it."""
        self.mass, self.moment = 0.0, (0.0, 0.0, 0.0)
        self._deviations: list[float] = []  # computed when they are asked for
        m = self.heaviest
        self.covariance = np.diag([m * m, *[(_UNKNOWN * m) ** 2] * 3])
        self._information = np.diag(1.0 / self.covariance.diagonal())

    @property
    def com(self) -> Vector:
        """c (3,) m, the centre of mass; the tool's origin while there is no load."""
        if self.mass < _LEAST:
            return (0.0, 0.0, 0.0)
        x, y, z = self.moment
        return x / self.mass, y / self.mass, z / self.mass

    def deviations(self) -> list[float]:
        """(4,) kg, m, m, m: standard deviations of mass and centre of mass, infinite where there is no load."""
        if not self._deviations:
            self._deviations = self._deviate()
        return self._deviations

    def _deviate(self) -> list[float]:
        P, m = self.covariance, self.mass
        heavier, lever = self._offset
        found = [sqrt(max(P.item(0, 0), 0.0) + heavier)]
        if m < _LEAST:
            return [*found, inf, inf, inf]
        for i, c in enumerate(self.com, 1):
            own = max(P.item(i, i) + c * c * P.item(0, 0) - 2 * c * P.item(0, i), 0.0)
            found.append(sqrt(own + lever + c * c * heavier) / m)
        return found

    def wrench(self, at: Motion, share: float = 1.0) -> list[float]:
        """The load's wrench (6,) N, N m on the tool, of a share of it."""
        m, c = share * self.mass, self.com
        x, y, z = self._pull(at, c)
        force = (m * x, m * y, m * z)
        return [*force, *cross(c, force)]

    def glance(self, wrench: list[float], at: Motion) -> tuple[float, Vector]:
        """The load (m, h) within the bounds that explains one wrench best, but for angular motion.

        The moment's part along gravity gives no torque; it is zero.
        """
        g = at.g
        size = max(square(g), 1.0)  # in free fall nothing is known
        m = (wrench[0] * g[0] + wrench[1] * g[1] + wrench[2] * g[2]) / size
        x, y, z = cross(g, (wrench[3], wrench[4], wrench[5]))
        return self._within(m, (x / size, y / size, z / size))

    def unexplained(self, wrench: list[float], at: Motion, threshold: tuple[float, float]) -> list[float]:
        """The part of a wrench (6,) beyond the load's that what isn't known of the load can't explain either.

        A centre of mass along gravity shows only once the tool turns: the torque is then the load's, not contact.

        Args:
            wrench: N, N m.
            at: the motion at that instant.
            threshold: N and N m, with which what isn't known is compared.
        """
        A = self._fill(at)
        B = A.dot(self.covariance)
        S = B.dot(A.T)
        S.flat[::7] += np.repeat(np.square(threshold), 3)
        r = np.array(wrench)
        found: list[float] = (r - B.dot(A.T.dot(np.linalg.solve(S, r)))).tolist()
        return found

    def take(self, mass: float, moment: Vector) -> None:
        """Begins with a load (kg, kg m) of which nothing else is known."""
        self.reset()
        self.mass, self.moment = self._within(mass, moment)
        self._deviations = []

    def update(self, wrench: list[float], at: Motion, dt: float, bandwidth: float = 0.0) -> None:
        """Takes a wrench (6,) N, N m of the load alone.

        Args:
            wrench: the load's wrench on the tool.
            at: the motion at that instant.
            dt: s since the last one.
            bandwidth: 1/s with which the estimate follows a load that changes; 0: it is constant.
        """
        A, Y = self._fill(at), self._information
        if bandwidth:
            self.covariance.flat[::5] += dt * bandwidth**2 * self._spread
            Y = np.linalg.inv(self.covariance)
        weighted = (dt / self._variances) * A.T
        Y = Y + weighted.dot(A)
        P = np.linalg.inv(Y)
        self._information, self.covariance, self._deviations = Y, 0.5 * (P + P.T), []
        change = P.dot(weighted.dot(np.array(wrench) - A.dot((self.mass, *self.moment)))).tolist()
        x, y, z = (a + b for a, b in zip(self.moment, change[1:], strict=True))
        self.mass, self.moment = self._within(self.mass + change[0], (x, y, z))

    @staticmethod
    def _pull(at: Motion, c: Vector) -> Vector:
        """Gravity less the acceleration of the point c, (3,) m/s^2."""
        swung, turned = cross(at.z, c), cross(at.w, cross(at.w, c))
        x, y, z = (g - a - b for g, a, b in zip(at.g, swung, turned, strict=True))
        return x, y, z

    def _within(self, m: float, h: Vector) -> tuple[float, Vector]:
        """The nearest load that can be: neither negative nor too heavy, its middle within reach."""
        m = min(max(m, 0.0), self.heaviest)
        size, most = sqrt(square(h)), self.reach * m
        if size <= most:
            return m, h
        k = most / size if size > 0.0 else 0.0
        return m, (k * h[0], k * h[1], k * h[2])

    def _fill(self, at: Motion) -> Array:
        """The wrench's derivatives (6, 4) by m and h."""
        A = self._regressor
        gx, gy, gz = self._pull(at, self.com)
        wx, wy, wz = at.w
        zx, zy, zz = at.z
        A[:3, 0] = at.g
        # -(z x h) - w x (w x h) = -([z] + w w' - w'w 1) h
        s = wx * wx + wy * wy + wz * wz
        A[0, 1:] = s - wx * wx, zz - wx * wy, -zy - wx * wz
        A[1, 1:] = -zz - wx * wy, s - wy * wy, zx - wy * wz
        A[2, 1:] = zy - wx * wz, -zx - wy * wz, s - wz * wz
        # h x g_c = -[g_c] h
        A[3, 1:] = 0.0, gz, -gy
        A[4, 1:] = -gz, 0.0, gx
        A[5, 1:] = gy, -gx, 0.0
        return A
