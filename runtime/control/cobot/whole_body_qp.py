"""What the two whole-body laws have in common when they keep limits: a quadratic program with two priorities.

Both laws are least-squares problems without inequalities. Under limits the best command is the one nearest to
theirs, counting first what the tool misses and then, where that leaves a choice, the law's own weights
(docs/whole-body-qp.md has the proof). So a limit that isn't active changes nothing, not even a bit.
"""

from __future__ import annotations

from typing import Annotated, Final

import daqp  # type: ignore[import-not-found]
import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from runtime.contracts.signals import Array
from runtime.control.robots import SUMMIT_XL, RobotDescription

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Three = tuple[_Positive, _Positive, _Positive]

ITERATIONS: Final = 200
"""Of the solver; it needs some 10. A count, not a time, so that a replay does the same."""
ACCELERATION: Final = 10.0
"""rad/s^2, of a joint whose maker publishes no limit."""
_BRAKING: Final = 0.8
"""Share of the acceleration limit that the approach to a position limit reckons with; the rest covers the cycle."""
_OPTIMAL: Final = 1
_TOLERANCE: Final = 1e-9


class LimitsConfig(BaseModel):
    """Options under `limits` of the laws that keep them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    margin: float = Field(0.02, ge=0, lt=0.5, description="rad kept off each joint's position limits")
    acceleration: _Positive | None = Field(
        None, description=f"rad/s^2 of each joint; null: the maker's, or {ACCELERATION:g} where none is published"
    )
    approach: float = Field(
        0.05, gt=0, le=1, description="s; a limit is approached like exp(-t / approach), so that it makes no step"
    )
    priority: float = Field(
        1e4, ge=1, le=1e9, description="how much more the tool's motion counts than the weights; 1e8 is all but strict"
    )
    base_acceleration: Three = Field((0.6, 0.6, 1.5), description="m/s^2, m/s^2, rad/s^2, the base's own axes")


def base_speeds(speed: Three | None) -> Array:
    """(3,) m/s, m/s, rad/s; infinite where there is no limit."""
    return np.full(3, np.inf) if speed is None else np.array(speed)


def maker_base_speed() -> Three:
    """m/s, m/s, rad/s: what the maker's own planner asks of the base."""
    return (*SUMMIT_XL.v_guard, SUMMIT_XL.w_guard)


class Approach:
    """Braking curves: the greatest speed at which a joint can still stop before its position limit.

    Over the distance d to the limit: k d close to it, where the braking fades out, and the square root of a steady
    deceleration further away; value and slope are continuous. k is half the inverse of `approach`.
    Both directions are worked out at once: arrays of 2n have those upwards first, then those downwards.
    """

    def __init__(self, robot: RobotDescription, config: LimitsConfig, speed: float | None) -> None:
        """speed: share of the joints' greatest speeds; None: unbounded."""
        self._n = robot.n
        self._ends = np.concatenate([robot.q_upper - config.margin, -robot.q_lower - config.margin])
        known = np.where(np.isfinite(robot.ddq_max), robot.ddq_max, ACCELERATION)
        self.acceleration: Array = known if config.acceleration is None else np.full(robot.n, config.acceleration)
        self.speed: Array = np.full(robot.n, np.inf) if speed is None else speed * robot.dq_max
        self._most, self._fastest = np.tile(self.acceleration, 2), np.tile(self.speed, 2)
        self._braking = _BRAKING * self._most
        self._time = config.approach

    def rate(self, dt: float) -> float:
        """1/s, of the approach; no faster than one cycle of dt seconds."""
        return 1.0 / max(self._time, dt)

    def _curve(self, q: Array, k: float) -> tuple[Array, Array]:
        """Speed (2n,), rad/s, negative beyond a limit, and slope (2n,), 1/s, at q (n,), rad."""
        a = self._braking
        near = a / (2.0 * k * k)
        left = self._ends - np.concatenate([q, -q])
        steady = np.sqrt(np.maximum(2.0 * a * (left - near), a * a / (k * k)))
        return steady + np.minimum(k * (left - 2.0 * near), 0.0), a / steady

    def speeds(self, q: Array, before: Array, dt: float) -> tuple[Array, Array]:
        """Least and greatest velocity (n,), rad/s, of the next dt seconds. Never empty: braking is always among them.

        before: (n,) rad/s, the velocity commanded in the cycle before.
        """
        n = self._n
        most = np.minimum(self._curve(q, 0.5 * self.rate(dt))[0], self._fastest)
        return intervals(-most[n:], most[:n], before, self.acceleration * dt)

    def accelerations(self, q: Array, qd: Array, dt: float) -> tuple[Array, Array]:
        """Least and greatest acceleration (n,), rad/s^2, at q (n,) and qd (n,). Never empty."""
        n, rate = self._n, self.rate(dt)
        curve, slope = self._curve(q, 0.5 * rate)
        v = np.concatenate([qd, -qd])
        # What is left of a speed limit shrinks at least like exp(-rate t): h_dot >= -rate h, h = limit - v.
        most = np.minimum(rate * (curve - v) - slope * v, rate * (self._fastest - v))
        most = np.minimum(np.maximum(most, -self._braking), self._most)
        least, greatest = -most[n:], most[:n]
        if (least > greatest).any():  # between limits that are too near to each other
            middle = 0.5 * (least + greatest)
            least, greatest = np.minimum(least, middle), np.maximum(greatest, middle)
        return least, greatest


def intervals(lower: Array, upper: Array, before: Array, step: Array) -> tuple[Array, Array]:
    """What of lower..upper can be reached by a change of at most `step`; if nothing, the nearest to it."""
    least, most = before - step, before + step
    return np.minimum(np.maximum(lower, least), most), np.maximum(np.minimum(upper, most), least)


class Nearest:
    """The point within limits nearest to a law's own x_0: first in the task A (x - x_0), then in the metric W.

    The order is kept by a weight, `priority`, both parts being scaled to one. Less of it follows the task less where
    limits leave it little choice, and moves less for it; a strict order jumps there.

    Attributes:
        failures: how often the solver found none.
    """

    def __init__(self, priority: float) -> None:
        self._priority = priority
        self.failures = 0

    def __call__(
        self, A: Array, Q: Array, W: Array, lower: Array, upper: Array, rows: Array | None = None
    ) -> Array | None:
        """x - x_0 (m,); None if the solver failed. Limits are those of x - x_0.

        Args:
            A: (6, m), the task.
            Q: (6,), weights of the task's residual.
            W: (m, m), positive definite.
            lower, upper: (m + r,), of each variable and of each row.
            rows: (r, m).
        """
        # Variables of similar size, so that one priority does for any weights.
        scale = 1.0 / np.sqrt(W.diagonal())
        task = A * scale
        H = task.T.dot(Q[:, None] * task)
        H *= self._priority / max(H.diagonal().max(), 1e-300)
        H += W * scale * scale[:, None]
        m = len(scale)
        least, most = lower.copy(), upper.copy()
        least[:m] /= scale
        most[:m] /= scale
        C = np.zeros((0, m)) if rows is None else np.ascontiguousarray(rows * scale)
        x, _, flag, _ = daqp.solve(
            H, np.zeros(m), C, most, least, primal_tol=_TOLERANCE, eps_prox=0.0, iter_limit=ITERATIONS
        )
        if flag != _OPTIMAL or not np.isfinite(x).all():
            self.failures += 1
            return None
        found: Array = np.minimum(np.maximum(x * scale, lower[:m]), upper[:m])
        return found


def turned_base(J: Array, cos: float, sin: float) -> Array:
    """The Jacobian (6, 3 + n) for base velocities in the base's own axes, which point along (cos, sin)."""
    turned = J.copy()
    turned[:, 0] = cos * J[:, 0] + sin * J[:, 1]
    turned[:, 1] = cos * J[:, 1] - sin * J[:, 0]
    return turned
