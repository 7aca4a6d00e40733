"""The common part of the two whole-body laws under limits: a quadratic program with two priorities.

Both laws are least-squares problems without inequalities. Under limits the best command is the one nearest to
the law's own. The first criterion is the tool's deviation; if this leaves a choice, the second one is the law's own
weights (docs/whole-body-qp.md has the proof). So a limit that isn't active changes nothing, not even a bit.
"""

from __future__ import annotations

from typing import Final, Protocol

import daqp  # type: ignore[import-not-found]
import numpy as np
from pydantic import Field

from srl.control.cobot.axes import OnPlanarTwist
from srl.control.cobot.robot_distances import DistancesConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import SUMMIT_XL

ITERATIONS: Final = 200
"""Limit of the solver's iterations; it needs some 10. It is a count, not a time, so that a replay does the same."""
ACCELERATION: Final = 10.0
"""rad/s^2, for a joint whose maker publishes no limit."""
_BRAKING: Final = 0.8
"""Share of the acceleration limit that the approach to a position limit uses; the rest covers the cycle."""
_OPTIMAL: Final = 1
_MISSED: Final = 2  # optimal, with a soft limit missed
_SOFT: Final = 8
_SOFTNESS: Final = 1e-9  # the square of what a soft limit is missed by costs its inverse
_TOLERANCE: Final = 1e-9


class ArmLimitsConfig(Options):
    """Options under `limits` of the laws that keep an arm's limits."""

    margin: float = Field(0.02, ge=0, lt=0.5, description="rad kept off each joint's position limits")
    acceleration: Positive | None = Field(
        None, description=f"rad/s^2 of each joint; null: the maker's, or {ACCELERATION:g} where none is published"
    )
    approach: float = Field(
        0.05, gt=0, le=1, description="s; a limit is approached like exp(-t / approach), so that it makes no step"
    )
    priority: float = Field(
        1e4, ge=1, le=1e9, description="how much more the tool's motion counts than the weights; 1e8 is all but strict"
    )


class LimitsConfig(ArmLimitsConfig):
    """Options under `limits` of the laws of an arm on a mobile base."""

    base_acceleration: OnPlanarTwist = Field((0.6, 0.6, 1.5), description="m/s^2, m/s^2, rad/s^2, the base's own axes")
    distances: DistancesConfig | None = Field(
        None, description="keeps the arm off itself, the base, the ground and obstacles; null: doesn't look"
    )


def base_speeds(speed: OnPlanarTwist | None) -> Array:
    """The base's speed limits (3,) m/s, m/s, rad/s; infinite without a limit."""
    return np.full(3, np.inf) if speed is None else np.array(speed)


def maker_base_speed() -> OnPlanarTwist:
    """The base's speeds, m/s, m/s, rad/s, that the maker's own planner commands."""
    return (*SUMMIT_XL.v_guard, SUMMIT_XL.w_guard)


class JointLimits(Protocol):
    """What `Approach` needs of an arm of n joints; arrays (n,): rad, rad/s, rad/s^2 (m where a joint slides)."""

    @property
    def n(self) -> int: ...
    @property
    def q_lower(self) -> Array: ...
    @property
    def q_upper(self) -> Array: ...
    @property
    def dq_max(self) -> Array: ...
    @property
    def ddq_max(self) -> Array: ...


def braking_curve(left: Array, a: Array | float, k: float) -> tuple[Array, Array]:
    """The greatest speed (k,), 1/s of the unit of `left`, at which a limit may be approached, and its slope (k,), 1/s.

    Args:
        left: (k,) to the limit; negative beyond it, where the speed is, too.
        a: the deceleration.
        k: 1/s, the slope near the limit.
    """
    near = a / (2.0 * k * k)
    steady = np.sqrt(np.maximum(2.0 * a * (left - near), a * a / (k * k)))
    return steady + np.minimum(k * (left - 2.0 * near), 0.0), a / steady


class Approach:
    """Braking curves: the greatest speed at which a joint can still stop before its position limit.

    The curve depends on the distance d to the limit. Close to it, where the braking fades out, it is k d. Further away
    it is the square root of a steady deceleration. Value and slope are continuous. k is half the inverse of `approach`.
    Both directions are computed at once: arrays of 2n hold the upward directions first, then the downward ones.
    """

    def __init__(self, robot: JointLimits, config: ArmLimitsConfig, speed: float | None) -> None:
        """`speed`: share of the joints' greatest speeds; None: unbounded."""
        self._n = robot.n
        self._ends = np.concatenate([robot.q_upper - config.margin, -robot.q_lower - config.margin])
        known = np.where(np.isfinite(robot.ddq_max), robot.ddq_max, ACCELERATION)
        self.acceleration: Array = known if config.acceleration is None else np.full(robot.n, config.acceleration)
        self.speed: Array = np.full(robot.n, np.inf) if speed is None else speed * robot.dq_max
        self._most, self._fastest = np.tile(self.acceleration, 2), np.tile(self.speed, 2)
        self._braking = _BRAKING * self._most
        self._time = config.approach

    def rate(self, dt: float) -> float:
        """The rate of the approach, 1/s; no faster than one cycle of dt seconds."""
        return 1.0 / max(self._time, dt)

    def _curve(self, q: Array, k: float) -> tuple[Array, Array]:
        """Speed (2n,), rad/s, negative beyond a limit, and slope (2n,), 1/s, at q (n,), rad."""
        return braking_curve(self._ends - np.concatenate([q, -q]), self._braking, k)

    def speeds(self, q: Array, before: Array, dt: float) -> tuple[Array, Array]:
        """Least and greatest velocity (n,), rad/s, for the next dt seconds.

        The range is never empty: it always contains braking. before: (n,) rad/s, the velocity commanded in the cycle
        before.
        """
        n = self._n
        most = np.minimum(self._curve(q, 0.5 * self.rate(dt))[0], self._fastest)
        return intervals(-most[n:], most[:n], before, self.acceleration * dt)

    def accelerations(self, q: Array, qd: Array, dt: float) -> tuple[Array, Array]:
        """Least and greatest acceleration (n,), rad/s^2, at q (n,) and qd (n,). The range is never empty."""
        n, rate = self._n, self.rate(dt)
        curve, slope = self._curve(q, 0.5 * rate)
        v = np.concatenate([qd, -qd])
        # The distance to a speed limit shrinks no faster than exp(-rate t): h_dot >= -rate h, h = limit - v.
        most = np.minimum(rate * (curve - v) - slope * v, rate * (self._fastest - v))
        most = np.minimum(np.maximum(most, -self._braking), self._most)
        least, greatest = -most[n:], most[:n]
        if (least > greatest).any():  # between limits that are too close to each other
            middle = 0.5 * (least + greatest)
            least, greatest = np.minimum(least, middle), np.maximum(greatest, middle)
        return least, greatest


def intervals(lower: Array, upper: Array, before: Array, step: Array) -> tuple[Array, Array]:
    """The part of lower..upper that a change of at most `step` can reach; if there is none, the nearest to it."""
    least, most = before - step, before + step
    return np.minimum(np.maximum(lower, least), most), np.maximum(np.minimum(upper, most), least)


class Nearest:
    """Finds the point within limits nearest to a law's own x_0: first in the task A (x - x_0), then in the metric W.

    A weight, `priority`, sets the order; both parts are scaled to one. Where limits leave the task little choice, a
    smaller weight follows the task less and moves less for it. A strict order jumps there.

    Attributes:
        failures: number of times that the solver found no solution.
    """

    def __init__(self, priority: float) -> None:
        self._priority = priority
        self.failures = 0

    def __call__(
        self, A: Array, Q: Array, W: Array, lower: Array, upper: Array, rows: Array | None = None, soft: int = 0
    ) -> Array | None:
        """Returns x - x_0 (m,); None if the solver failed. The limits are those of x - x_0.

        Soft rows are kept where the other limits allow it, and else missed by as little as possible.

        Args:
            A: (k, m), the task: 6 rows of a twist, 3 of a point.
            Q: (k,), weights of the task's residual.
            W: (m, m), the metric, positive definite.
            lower, upper: (m + r,), limits of each variable and of each row.
            rows: (r, m), the rows.
            soft: how many of the last rows are soft.
        """
        # The variables are scaled to similar size, so that one priority suits any weights.
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
        kinds = np.zeros(len(most), dtype=np.int32)
        kinds[len(most) - soft :] = _SOFT
        x, _, flag, _ = daqp.solve(
            H,
            np.zeros(m),
            C,
            most,
            least,
            kinds,
            primal_tol=_TOLERANCE,
            eps_prox=0.0,
            iter_limit=ITERATIONS,
            rho_soft=_SOFTNESS,
        )
        if flag not in (_OPTIMAL, _MISSED) or not np.isfinite(x).all():
            self.failures += 1
            return None
        found: Array = np.minimum(np.maximum(x * scale, lower[:m]), upper[:m])
        return found


def turned_base(J: Array, cos: float, sin: float) -> Array:
    """Rows (k, 3 + n) for base velocities in the base's own axes, which point along (cos, sin)."""
    turned = J.copy()
    turned[:, 0] = cos * J[:, 0] + sin * J[:, 1]
    turned[:, 1] = cos * J[:, 1] - sin * J[:, 0]
    return turned
