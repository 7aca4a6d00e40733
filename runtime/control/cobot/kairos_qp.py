"""Kairos' whole-body inverse kinematics under limits: a quadratic program with two priorities.

This is `kairos-clik` (Giammarino et al. 2022, eqs. 10 to 17) with position, velocity and acceleration limits of joints
and base as inequalities. Formulation: docs/whole-body-qp.md.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np
from pydantic import Field

from runtime.contracts.signals import Array
from runtime.control.cobot.axes import OnPlanarTwist
from runtime.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from runtime.control.cobot.whole_body import BASE
from runtime.control.cobot.whole_body_qp import (
    Approach,
    LimitsConfig,
    Nearest,
    base_speeds,
    intervals,
    maker_base_speed,
    turned_base,
)
from runtime.control.robots import ARMS


class KairosQpConfig(KairosClikConfig):
    """Options of `kairos-qp`: those of `kairos-clik` and `limits`."""

    base_speed: OnPlanarTwist | None = Field(
        maker_base_speed(), description="m/s, m/s, rad/s, the most; null: unbounded"
    )
    limits: LimitsConfig = LimitsConfig()


class KairosQp(KairosClik):
    """Whole-body inverse kinematics under limits. Inputs and outputs are those of `kairos-clik`.

    Where a limit is active, the other joints and the base take over, so that the tool follows as well as it can.
    `kairos-clik` slows down all velocities instead. Changes of the velocity are bounded from the first cycle on.
    """

    Config = KairosQpConfig
    summary = "kairos-clik as a quadratic program: joint and base limits as inequalities"

    def __init__(self, name: str, config: KairosQpConfig) -> None:
        super().__init__(name, config)
        robot, limits = ARMS[config.robot], config.limits
        self._approach = Approach(robot, limits, config.speed)
        self._base_speed = base_speeds(config.base_speed)
        self._base_acceleration = np.array(limits.base_acceleration)
        self._nearest = Nearest(limits.priority)
        self._W1 = np.array(config.tracking)
        self._k = 1.0
        self._dt = 0.0
        self._limited = 0
        self._missed = 0.0

    def figures(self) -> dict[str, object]:
        """Returns the base class's figures, without `slowed`, and those of the limits.

        They are the share of cycles with an active limit, the greatest speed missed by the tool, and solver failures.
        """
        found = super().figures()
        del found["slowed"]
        return found | {
            "limited": self._limited / max(self._cycles, 1),
            "missed_m_s": self._missed,
            "solver_failures": self._nearest.failures,
        }

    def _step(self, dt: float) -> None:
        self._dt = dt
        super()._step(dt)

    def _damping(self, Ja: Array) -> float:
        self._k = super()._damping(Ja)
        return self._k

    def _send(self, arm: list[float], base: list[float], w_a: float, dt: float) -> None:
        """Fills the outputs with the velocities nearest to the law's within the limits."""
        yaw = self.input["base_pose"].item(2)
        c, s = cos(yaw), sin(yaw)
        x0 = np.array([*base, *arm])
        lower, upper = self._limits()
        x = x0
        if (x0 < lower).any() or (x0 > upper).any():
            A = turned_base(self.input["jacobian"], c, s)
            away = self._nearest(A, self._W1, self._weights(len(x0)), lower - x0, upper - x0)
            # Without a solution: brake, which is always within the limits.
            x = np.minimum(np.maximum(0.0 if away is None else x0 + away, lower), upper)
            self._limited += self._dt > 0.0
            missed = A[:3].dot(x - x0)
            self._missed = max(self._missed, float(missed.dot(missed)) ** 0.5)
        self.output["base_twist"][:] = x[:BASE]
        self.output["velocity"][:] = x[BASE:]

    def _limits(self) -> tuple[Array, Array]:
        """Least and greatest velocities (3 + n,), the base's first and in its own axes."""
        dt = self._dt
        out, applied = self.output, self.applied
        least, most = self._approach.speeds(self.input["q"], applied.get("velocity", out["velocity"]), dt)
        base = intervals(
            -self._base_speed,
            self._base_speed,
            applied.get("base_twist", out["base_twist"]),
            self._base_acceleration * dt,
        )
        return np.concatenate([base[0], least]), np.concatenate([base[1], most])

    def _weights(self, size: int) -> Array:
        """W_2 (3 + n, 3 + n)."""
        c, priority = self._config, self._priority
        W = np.zeros((size, size))
        np.fill_diagonal(W, priority.between_ratios(c.manipulation.arm, c.locomotion.arm) * self._k * self._k)
        w_b = priority.between_ratios(c.manipulation.base, c.locomotion.base)
        W[0, 0] = W[1, 1] = W[2, 2] = w_b
        return W
