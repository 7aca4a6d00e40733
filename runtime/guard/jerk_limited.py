"""The fastest motion of one joint to rest with bounded jerk, by ruckig (Berscheid and Kroeger, 2021).

Loaded only where a jerk is bounded: ruckig has no wheel for every machine.
"""

from __future__ import annotations

from collections.abc import Sequence

import ruckig


class JerkLimited:
    """Plans for several joints, one at a time; what is given stays in the joint's own request."""

    def __init__(self, jerk: Sequence[float]) -> None:
        """`jerk`: of each joint, unit/s^3."""
        self._otg, self._plan = ruckig.Ruckig(1), ruckig.Trajectory(1)
        self._asks = [ruckig.InputParameter(1) for _ in jerk]
        for ask, J in zip(self._asks, jerk, strict=True):
            ask.target_position, ask.max_jerk = [0.0], [J]

    def after(
        self, i: int, x: float, xd: float, xdd: float, slowest: float, fastest: float, most: float, dt: float
    ) -> tuple[float, float, float] | None:
        """Position, velocity and acceleration after dt on the fastest motion of joint i to rest at zero.

        Args:
            x, xd, xdd: where it is, how fast, and its acceleration.
            slowest, fastest: bounds of its velocity.
            most: bound of its acceleration.
        Returns:
            None if there is no such motion.
        """
        ask = self._asks[i]
        ask.current_position, ask.current_velocity, ask.current_acceleration = [x], [xd], [xdd]
        ask.min_velocity, ask.max_velocity, ask.max_acceleration = [slowest], [fastest], [most]
        try:
            if self._otg.calculate(ask, self._plan) != ruckig.Result.Working:
                return None
            (x,), (xd,), (xdd,) = self._plan.at_time(dt)
        except ruckig.RuckigError:
            return None
        if dt >= self._plan.duration:
            return 0.0, 0.0, 0.0  # without the rounding errors of the motion
        return x, xd, xdd
