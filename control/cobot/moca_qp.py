"""MOCA's whole-body impedance under limits: a quadratic program with two priorities.

This is `moca-impedance` (Giammarino et al. 2022, eqs. 2 to 9) with position, velocity, acceleration and torque limits
of the joints and speed and acceleration limits of the base as inequalities. Formulation: docs/whole-body-qp.md.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
from pydantic import Field

from srl.control.cobot.axes import OnPlanarTwist
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig, Rotors, _Planar
from srl.control.cobot.robot_distances import OPENING, RobotDistances
from srl.control.cobot.whole_body import BASE
from srl.control.cobot.whole_body_qp import (
    Approach,
    LimitsConfig,
    Nearest,
    base_speeds,
    braking_curve,
    maker_base_speed,
    turned_base,
)
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array


class MocaLimitsConfig(LimitsConfig):
    """Options under `limits` of `moca-qp`."""

    speed: float | None = Field(1.0, gt=0, le=1, description="share of the joints' greatest speeds; null: unbounded")
    effort: float = Field(1.0, gt=0, le=1, description="share of the joints' greatest torques, of the whole command")
    priority: float = Field(
        3e3, ge=1, le=1e9, description="how much more the tool's motion counts than the weights; 1e8 is all but strict"
    )
    base_speed: OnPlanarTwist | None = Field(maker_base_speed(), description="m/s, m/s, rad/s; null: unbounded")


class MocaQpConfig(MocaImpedanceConfig):
    """Options of `moca-qp`: those of `moca-impedance` and `limits`."""

    rotors: Rotors = Field(
        "all", description="as in `moca-impedance`; motion limits hold only if all of the mass counts"
    )
    limits: MocaLimitsConfig = MocaLimitsConfig()


class MocaQp(MocaImpedance):
    """Whole-body impedance control under limits. Inputs and outputs are those of `moca-impedance`.

    The variables are the generalised torques tau_c = (tau_v, tau_a), with the base's torques in its own axes. Torque
    and base limits bound each of them singly. The joints' motion limits bound M_a^-1 tau_a, the acceleration that the
    arm is given. With `limits.distances` the arm keeps off itself, the base, the ground and obstacles.
    """

    Config = MocaQpConfig
    summary = "moca-impedance as a quadratic program: joint, torque and base limits as inequalities"

    def __init__(self, name: str, config: MocaQpConfig) -> None:
        super().__init__(name, config)
        robot, limits = config.robot, config.limits
        n = robot.n
        self._keep_off = limits.distances
        self._approach = Approach(robot, limits, limits.speed)
        self._effort: Array = limits.effort * robot.tau_max
        self._base_speed = base_speeds(limits.base_speed)
        self._base_acceleration = np.array(limits.base_acceleration)
        self._nearest = Nearest(limits.priority)
        # A missed acceleration counts like a missed force: K_d says how metres compare with radians.
        self._Q = np.array(config.stiffness) / max(config.stiffness)
        m, j = config.virtual_mass
        self._base_mass = np.array([m, m, j])
        self._mobility: Array = np.zeros((BASE + n, BASE + n))  # M^-1
        self._mobility[range(BASE), range(BASE)] = 1.0 / self._base_mass
        self._distances: RobotDistances | None = None
        self._limited = self._conflicts = 0
        self._missed = 0.0

    def metrics(self) -> dict[str, object]:
        """Returns the base class's figures and those of the limits.

        They are the shares of cycles with an active limit and with torques too weak to keep the motion's limits, the
        greatest acceleration missed by the tool, and solver failures.
        """
        cycles = max(self._cycles, 1)
        return super().metrics() | {
            "limited": self._limited / cycles,
            "too_weak": self._conflicts / cycles,
            "missed_m_s2": self._missed,
            "solver_failures": self._nearest.failures,
            **({} if self._distances is None else self._distances.metrics()),
        }

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        if self._keep_off is not None:
            mount = rotation.homogeneous(self.transform["mount"])
            self._distances = RobotDistances(self._robot, mount, self._keep_off)

    def _within(
        self, tau_v: _Planar, tau_a: Array, bias: Array, inverse_mass: Array, eta: tuple[float, float], dt: float
    ) -> tuple[_Planar, Array]:
        """The law's torques, or the nearest ones within the limits."""
        yaw = self.input["base_pose"].item(2)
        c, s = cos(yaw), sin(yaw)
        vx, vy, wz = tau_v
        x0 = np.concatenate([(c * vx + s * vy, c * vy - s * vx, wz), tau_a])
        base_least, base_most = self._base_limits(dt)
        lower = np.concatenate([base_least, -self._effort - bias])
        upper = np.concatenate([base_most, self._effort - bias])
        least, most = self._approach.accelerations(self.input["q"], self.input["qd"], dt)
        a0 = inverse_mass.dot(tau_a)
        Mi = self._mobility
        Mi[BASE:, BASE:] = inverse_mass
        gaps, away_at_least = self._gaps(Mi, c, s, dt)
        kept = (x0 >= lower).all() and (x0 <= upper).all() and (a0 >= least).all() and (a0 <= most).all()
        if kept and (gaps.dot(x0) >= away_at_least).all():
            return tau_v, tau_a
        self._limited += dt > 0.0
        # A stop that the torques can produce: it keeps the program solvable if they are too weak for the limits.
        qd = self.input["qd"]
        wanted = np.minimum(np.maximum(-self._approach.rate(dt) * qd, least), most)
        stop = np.minimum(np.maximum(np.linalg.solve(inverse_mass, wanted), lower[BASE:]), upper[BASE:])
        given = inverse_mass.dot(stop)
        self._conflicts += dt > 0.0 and bool((np.abs(given - wanted) > 1e-6).any())
        least, most = np.minimum(least, given), np.maximum(most, given)

        A = turned_base(self.input["jacobian"], c, s).dot(Mi)
        weights = np.repeat(eta, (BASE, len(tau_a)))
        W = Mi * weights * weights[:, None]  # eq. 6
        away = self._nearest(
            A,
            self._Q,
            W,
            np.concatenate([lower - x0, least - a0, away_at_least - gaps.dot(x0)]),
            np.concatenate([upper - x0, most - a0, np.full(len(gaps), np.inf)]),
            np.concatenate([Mi[BASE:], gaps]),
            soft=len(gaps),  # torques and base may be too weak for a gap that closes by itself
        )
        if away is None:  # a damped stop
            x = np.concatenate([np.minimum(np.maximum(0.0, base_least), base_most), stop])
        else:
            x = np.minimum(np.maximum(x0 + away, lower), upper)
        missed = A[:3].dot(x - x0)
        self._missed = max(self._missed, float(missed.dot(missed)) ** 0.5)
        X, Y, turn = x[:BASE].tolist()
        return (c * X - s * Y, s * X + c * Y, turn), x[BASE:]

    def _gaps(self, Mi: Array, c: float, s: float, dt: float) -> tuple[Array, Array]:
        """Rows (k, 3 + n) on the torques, and the least second derivative of each gap (k,), m/s^2.

        As for joints: h = v(d) + d_dot shrinks no faster than exp(-rate t). The gradient's own change is left out.
        """
        distances, options = self._distances, self._keep_off
        if distances is None or options is None or dt == 0.0:
            return np.zeros((0, len(Mi))), np.zeros(0)
        twist = self.applied.get("base_twist", self.output["base_twist"])
        velocity = np.concatenate([twist, self.input["qd"]])
        near = distances(np.concatenate([self.input["base_pose"], self.input["q"]]), velocity)
        self.contact = near.overlaps
        gradient = turned_base(near.gradient, c, s)
        speed = gradient.dot(velocity)
        rate = self._approach.rate(dt)
        curve, slope = braking_curve(near.distance - options.least, options.braking, 0.5 * rate)
        slope = np.where(curve < -OPENING, 0.0, slope)
        curve = np.maximum(curve, -OPENING)
        least = np.minimum(-rate * (curve + speed) - slope * speed, options.braking)
        drag = self._config.base_damping * gradient[:, :BASE].dot(twist)  # of eq. 2, which tau_v has to make up for
        return gradient.dot(Mi), least + drag

    def _base_limits(self, dt: float) -> tuple[Array, Array]:
        """Least and greatest tau_v (3,), N, N, N m in the base's own axes. The range is never empty."""
        if dt == 0.0:
            return np.full(BASE, -np.inf), np.full(BASE, np.inf)  # nothing moves
        v = self.applied.get("base_twist", self.output["base_twist"])
        most, V = self._base_acceleration, self._base_speed
        rate = self._approach.rate(dt)
        # Accelerations: they fade out towards the greatest speed.
        up = np.maximum(np.minimum(rate * (V - v), most), -most)
        down = np.minimum(np.maximum(-rate * (V + v), -most), most)
        # Eq. 2 as `_move_base` steps it, solved for tau: v + dt a = (v + dt tau / m) / (1 + dt damping).
        drag = self._config.base_damping
        grown = 1.0 + dt * drag
        mass = self._base_mass
        return mass * (grown * down + drag * v), mass * (grown * up + drag * v)
