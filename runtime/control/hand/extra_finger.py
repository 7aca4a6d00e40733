"""A robotic extra finger: its place on the body, its chain, and its inverse kinematics, equation (5)."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, sin, sqrt
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from runtime.contracts.errors import OptionError
from runtime.contracts.signals import Array
from runtime.control.models import FingerOption, named
from runtime.control.shared.kinematics import Chain
from runtime.control.shared.symmetric import Vector, dot, gram, raised_inverse, times

Matrix = tuple[tuple[float, float, float, float], ...]

_HELD: Final = (0.0, 0.0, 0.0)  # the column of J of a joint at its limit


class Base(BaseModel):
    """A pose in frame `hand`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    xyz: Vector = Field(description="m")
    rpy: Vector = Field(default=(0.0, 0.0, 0.0), description="rad, about the fixed axes x, then y, then z")


class ExtraFinger(BaseModel):
    """One extra finger: its description and its place. The default is worn at the wrist, opposite the palm.

    The place is the paper's; its axes are ours: at zero the finger points straight out of the palm, and positive
    flexion closes it toward the fingers. In a profile the plain name of a model stands for {model: NAME}.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: FingerOption = named("finger")
    name: str = Field(default="finger", pattern=r"^[a-z][a-z0-9_]*$", description="left out: the model's")
    base: Base | Matrix = Field(
        default=(
            (0.0, -1.0, 0.0, 0.0),
            (0.0, 0.0, 1.0, -0.020),
            (-1.0, 0.0, 0.0, -0.030),
            (0.0, 0.0, 0.0, 1.0),
        ),
        description="place in frame hand: {xyz, rpy} or a 4 x 4 transformation, m",
    )

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:
        if isinstance(given, str):
            return {"model": given, "name": given}
        if not isinstance(given, Mapping):
            return given
        if old := {"joints", "rows", "lower", "upper"} & given.keys():
            remedy = "Write models: {finger: {kind: finger, rows: ...}}, and its name here"
            raise OptionError(f"`{min(old)}` of a finger stands in `models:` now", remedy)
        model = given.get("model")
        return {"name": model, **given} if isinstance(model, str) else given

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
        model = finger.model
        self.chain = Chain(finger.transformation(), np.array(model.rows))
        self.n = len(model.rows)
        self._limits = [(low, 0.5 * (low + high), high) for low, high in zip(model.lower, model.upper, strict=True)]
        self._damping2 = damping**2
        self._curvature = 0.5 * sum(abs(a) for _, a in model.rows)

    def follow(self, q: list[float], dp: Vector, v: Vector, pull: float) -> tuple[list[float], list[float]]:
        """(5): dq_a = J_a^+ dp_a + N_J chi, within the joint limits, and the rate for the tip's velocity.

        A joint that would pass its limit stops there, and the others take over what they can.

        Args:
            q: (n,) rad, for which `chain.forward` was called last.
            dp: m, desired displacement of the tip.
            v: m/s, desired velocity of the tip.
            pull: chi = pull (middle - q), 0..1.
        Returns:
            dq (n,) rad, dq/dt (n,) rad/s.
        """
        J = self.chain.jacobian()
        room = [(low - x, high - x) for x, (low, _, high) in zip(q, self._limits, strict=True)]
        # chi and J of the free joints. A held joint has a given step, and its column of J is zero.
        chi = [pull * (middle - x) for x, (_, middle, _) in zip(q, self._limits, strict=True)]
        free = list(J)
        # Near the border of the workspace the tip's displacement is quadratic in the joints: a long step would
        # overshoot.
        floor = max(self._damping2, self._curvature * sqrt(dot(dp, dp)))
        while True:
            # J^+ = J^T (J J^T)^-1, and N_J chi = chi - J^+ J chi
            inverse = raised_inverse(gram(free), floor)
            x, y, z = dp
            for (jx, jy, jz), step in zip(J, chi, strict=True):
                x, y, z = x - jx * step, y - jy * step, z - jz * step
            way, rate = times(inverse, (x, y, z)), times(inverse, v)
            again, dq = False, []
            for j, (low, high) in enumerate(room):
                step = chi[j] + dot(free[j], way)
                allowed = low if step < low else high if step > high else step
                if allowed != step:
                    chi[j], free[j], again = allowed, _HELD, True
                dq.append(step)
            if not again:
                return dq, [dot(column, rate) for column in free]
