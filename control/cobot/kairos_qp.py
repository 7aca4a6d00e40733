"""Kairos' whole-body inverse kinematics under limits: a quadratic program with two priorities.

This is `kairos-clik` (Giammarino et al. 2022, eqs. 10 to 17) with position, velocity and acceleration limits of joints
and base as inequalities. Formulation: docs/whole-body-qp.md.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
from pydantic import Field

from srl.control.cobot.axes import OnPlanarTwist
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.robot_distances import OPENING, RobotDistances
from srl.control.cobot.whole_body import BASE, mount_of_the_arm
from srl.control.cobot.whole_body_qp import (
    Approach,
    LimitsConfig,
    Nearest,
    base_speeds,
    braking_curve,
    intervals,
    maker_base_speed,
    turned_base,
)
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array


class KairosLimitsConfig(LimitsConfig):
    """Options under `limits` of `kairos-qp`."""

    catch_up: float = Field(
        5.0,
        ge=0,
        le=20,
        description="1/s with which motion that limits withheld is made up for; 0: as kairos-clik does",
    )
    behind: float = Field(0.03, ge=0, le=0.2, description="m that are made up for at most, and rad times 5")


class KairosQpConfig(KairosClikConfig):
    """Options of `kairos-qp`: those of `kairos-clik` and `limits`."""

    base_speed: OnPlanarTwist | None = Field(
        maker_base_speed(), description="m/s, m/s, rad/s, the most; null: unbounded"
    )
    limits: KairosLimitsConfig = KairosLimitsConfig()


class KairosQp(KairosClik):
    """Whole-body inverse kinematics under limits. Inputs and outputs are those of `kairos-clik`.

    Where a limit is active, the other joints and the base take over, so that the tool follows as well as it can. What
    it still misses is made up for later (`catch_up`). `kairos-clik` slows down all velocities instead. Changes of the
    velocity are bounded from the first cycle on. With `limits.distances` the arm keeps off itself, the base, the ground
    and obstacles.
    """

    Config = KairosQpConfig
    summary = "kairos-clik as a quadratic program: joint and base limits as inequalities"

    def __init__(self, name: str, config: KairosQpConfig) -> None:
        super().__init__(name, config)
        robot, limits = config.robot, config.limits
        self._limits_config = limits
        self._approach = Approach(robot, limits, config.speed)
        self._base_speed = base_speeds(config.base_speed)
        self._base_acceleration = np.array(limits.base_acceleration)
        self._nearest = Nearest(limits.priority)
        self._W1 = np.array(config.tracking)
        self._distances: RobotDistances | None = None
        if limits.distances is not None and all(t.name != "mount" for t in self.transforms):
            self.transforms = (*self.transforms, mount_of_the_arm())
        self._behind: Array = np.zeros(6)  # m, rad: the tool behind where the closed form alone would have it
        self._catching_up: Array = np.zeros(6)
        self._k = 1.0
        self._dt = 0.0
        self._limited = 0
        self._missed = 0.0

    def metrics(self) -> dict[str, object]:
        """Returns the base class's figures, without `slowed`, and those of the limits.

        They are the share of cycles with an active limit, the greatest speed missed by the tool, and solver failures.
        """
        found = super().metrics()
        del found["slowed"]
        return found | {
            "limited": self._limited / max(self._cycles, 1),
            "missed_m_s": self._missed,
            "solver_failures": self._nearest.failures,
            **({} if self._distances is None else self._distances.metrics()),
        }

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        options = self._limits_config.distances
        if options is not None:
            mount = rotation.homogeneous(self.transform["mount"])
            self._distances = RobotDistances(self._config.robot, mount, options)

    def reset(self) -> None:
        self._behind[:] = 0.0
        super().reset()

    def _step(self, dt: float) -> None:
        self._dt = dt
        super()._step(dt)

    def _task(self, dt: float) -> Array:
        self._catching_up = self._limits_config.catch_up * self._behind
        return super()._task(dt) + self._catching_up

    def _damping(self, Ja: Array) -> float:
        self._k = super()._damping(Ja)
        return self._k

    def _send(self, arm: list[float], base: list[float], w_a: float, dt: float) -> None:
        """Fills the outputs with the velocities nearest to the law's within the limits."""
        yaw = self.input["base_pose"].item(2)
        A = turned_base(self.input["jacobian"], cos(yaw), sin(yaw))
        x0 = np.array([*base, *arm])
        lower, upper = self._limits()
        rows, away_at_least = self._gaps(yaw, len(x0))
        x = x0
        if (x0 < lower).any() or (x0 > upper).any() or (rows.dot(x0) < away_at_least).any():
            free = np.full(len(rows), np.inf)
            away = self._nearest(
                A,
                self._W1,
                self._weights(len(x0)),
                np.concatenate([lower - x0, away_at_least - rows.dot(x0)]),
                np.concatenate([upper - x0, free]),
                rows,
                soft=len(rows),  # joints and base may be too slow for a gap that closes by itself
            )
            # Without a solution: brake, which is always within the limits.
            x = np.minimum(np.maximum(0.0 if away is None else x0 + away, lower), upper)
            self._limited += self._dt > 0.0
        missed = A.dot(x0 - x)
        self._missed = max(self._missed, float(missed[:3].dot(missed[:3])) ** 0.5)
        if np.isfinite(missed).all():  # else the guard refuses the outputs, and nothing of it may stay
            self._fall_behind(missed)
        self.output["base_twist"][:] = x[:BASE]
        self.output["velocity"][:] = x[BASE:]

    def _fall_behind(self, missed: Array) -> None:
        """Follows how far the tool is behind. missed: (6,) m/s, rad/s, of the twist of this cycle."""
        limits = self._limits_config
        gain = self._ramps.values["gain"] * np.array(self._config.gain)
        # The law's own K already works on the same gap.
        self._behind += self._dt * (missed - self._catching_up - gain * self._behind)
        for part, most in ((slice(0, 3), limits.behind), (slice(3, 6), 5.0 * limits.behind)):
            gap = self._behind[part]
            self._behind[part] = gap * min(1.0, most / max(float(gap.dot(gap)) ** 0.5, 1e-12))

    def _gaps(self, yaw: float, size: int) -> tuple[Array, Array]:
        """Rows (k, 3 + n) on the velocities, the base's in its own axes, and the least rate of each gap (k,), m/s."""
        distances, options = self._distances, self._limits_config.distances
        if distances is None or options is None:
            return np.zeros((0, size)), np.zeros(0)
        before = [self.applied.get(name, self.output[name]) for name in ("base_twist", "velocity")]
        near = distances(np.concatenate([self.input["base_pose"], self.input["q"]]), np.concatenate(before))
        self.contact = near.overlaps
        rows = turned_base(near.gradient, cos(yaw), sin(yaw))
        speed, _ = braking_curve(near.distance - options.least, options.braking, 0.5 * self._approach.rate(self._dt))
        return rows, np.minimum(-speed, OPENING)

    def _limits(self) -> tuple[Array, Array]:
        """Least and greatest velocities (3 + n,), the base's first and in its own axes."""
        dt = self._dt
        out, applied = self.output, self.applied
        least, most = self._approach.speeds(self.input["q"], applied.get("velocity", out["velocity"]), dt)
        share = self._ramps.values["speed"]
        if share < 1.0 and self._fastest is not None:
            # The share changes more slowly than the joints can brake.
            fastest = share * np.array(self._fastest)
            least, most = np.minimum(np.maximum(least, -fastest), most), np.maximum(np.minimum(most, fastest), least)
        base = intervals(
            -share * self._base_speed,
            share * self._base_speed,
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
