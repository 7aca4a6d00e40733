"""A robotic extra finger: where it is worn, its chain, and its inverse kinematics, equation (5)."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from runtime.control.kinematics import Chains
from runtime.signals import Array

Vector = tuple[float, float, float]
Matrix = tuple[tuple[float, float, float, float], ...]


class Base(BaseModel):
    """A place in frame `hand`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    xyz: Vector = Field(description="m")
    rpy: Vector = Field(default=(0.0, 0.0, 0.0), description="rad, about the fixed axes x, then y, then z")


class ExtraFinger(BaseModel):
    """One extra finger. The default is the sixth finger, worn at the wrist, opposite the palm.

    Its modules' size and where it is worn are the paper's. The paper's Denavit-Hartenberg table is lost, so
    rows and base are ours: straight out of the palm at zero, positive flexion closing toward the fingers.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(default="finger", pattern=r"^[a-z][a-z0-9_]*$", description="begins its joints' labels")
    base: Base | Matrix = Field(
        default=(
            (0.0, -1.0, 0.0, 0.0),
            (0.0, 0.0, 1.0, -0.020),
            (-1.0, 0.0, 0.0, -0.030),
            (0.0, 0.0, 0.0, 1.0),
        ),
        description="place in frame hand: {xyz, rpy} or a 4 x 4 transformation, m",
    )
    rows: tuple[tuple[float, float], ...] = Field(
        default=((pi / 2, 0.015), (0.0, 0.042), (0.0, 0.042), (0.0, 0.042)),
        min_length=1,
        description="standard Denavit-Hartenberg rows [alpha rad, a m], one a joint",
    )
    lower: tuple[float, ...] = Field(
        default=(-pi / 3, -pi / 2, -pi / 2, -pi / 2), description="rad, a joint each"
    )
    upper: tuple[float, ...] = Field(
        default=(pi / 3, pi / 2, pi / 2, pi / 2), description="rad, a joint each"
    )

    @field_validator("base")
    @classmethod
    def _is_rigid(cls, base: Base | Matrix) -> Base | Matrix:
        if not isinstance(base, Base):
            T = np.array(base)
            R = T[:3, :3]
            if T.shape != (4, 4) or not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
                raise ValueError("base must be a 4 x 4 transformation with last row 0, 0, 0, 1")
            if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
                raise ValueError("base's upper left 3 x 3 must be a rotation")
        return base

    @model_validator(mode="after")
    def _fits(self) -> ExtraFinger:
        if not len(self.rows) == len(self.lower) == len(self.upper):
            raise ValueError("rows, lower and upper must have one entry a joint")
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError("every lower limit must be below its upper limit")
        return self

    def transformation(self) -> Array:
        """The base in frame hand, (4, 4)."""
        if not isinstance(self.base, Base):
            return np.array(self.base)
        (cr, cp, cy), (sr, sp, sy) = (tuple(map(f, self.base.rpy)) for f in (cos, sin))
        T = np.eye(4)
        T[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        T[:3, 3] = self.base.xyz
        return T


class FingerKinematics:
    """Moves one finger's joints so that its tip follows."""

    def __init__(self, finger: ExtraFinger, damping: float) -> None:
        """Args:
        damping: m/rad; singular values of J below it are damped.
        """
        self._chains = Chains(finger.transformation()[None], np.array([finger.rows]))
        self.lower, self.upper = np.array(finger.lower), np.array(finger.upper)
        self.middle = 0.5 * (self.lower + self.upper)
        self.n = len(finger.rows)
        self._damping2 = damping**2
        self._curvature = 0.5 * sum(abs(a) for _, a in finger.rows)

    def tip(self, q: Array) -> Array:
        """(3,) m, a view that the next call overwrites."""
        return self._chains.forward(q[None])[0]

    def skeleton(self) -> Array:
        """(n + 1, 3) m: the base, then each row's end, at the q of the last `tip`."""
        return cast(Array, self._chains.frames[:, 0, :3, 3])

    def follow(self, q: Array, dp: Array, v: Array, pull: float) -> tuple[Array, Array]:
        """(5): dq_a = J_a^+ dp_a + N_J chi, within the joint limits, and the rate for the tip's velocity.

        A joint that would pass its limit stops there, and the others take over what they can.

        Args:
            q: (n,) rad, for which `tip` was called last.
            dp: (3,) m, how far the tip is to go.
            v: (3,) m/s, its velocity.
            pull: chi = pull (middle - q), 0..1.
        Returns:
            dq (n,) rad, dq/dt (n,) rad/s.
        """
        J = self._chains.jacobian()[0, :3]
        low, high = self.lower - q, self.upper - q
        chi = pull * (self.middle - q)
        # Near the border of the workspace the way is quadratic in the joints: a long step would overshoot.
        floor = max(self._damping2, self._curvature * sqrt(dp @ dp))
        inverse = _invert(J, floor)
        dq, rate = chi + inverse @ (dp - J @ chi), inverse @ v  # N_J chi = chi - J^+ J chi
        allowed = np.minimum(np.maximum(dq, low), high)
        held = beyond = dq != allowed
        while beyond.any():
            fixed = np.where(held, allowed, chi)
            inverse = _invert(np.where(held, 0.0, J), floor)
            dq = fixed + inverse @ (dp - J @ fixed)
            rate = np.where(held, 0.0, inverse @ v)
            allowed = np.minimum(np.maximum(dq, low), high)
            beyond = ~held & (dq != allowed)
            held = held | beyond
        return np.where(held, allowed, dq), rate


def _invert(J: Array, floor: float) -> Array:
    """Damped J^+ (n, 3) = J^T (J J^T)^-1.

    Eigenvalues of J J^T below `floor` are raised to it: singular values s of J from sqrt(floor) up are
    inverted exactly, lesser ones become s / floor.
    """
    lam, U = np.linalg.eigh(J @ J.T)
    return cast(Array, J.T @ ((U / np.maximum(lam, floor)) @ U.T))
