"""MOCA's weighted whole-body Cartesian impedance (Giammarino et al. 2022, eqs. 2 to 9, appendix B).

The arm is in torque control, the base in velocity control. The base gets the dynamics of a virtual mass, so that
both form one system with generalised torques tau_c = (tau_v, tau_a). eta_B and eta_A decide which of them moves.
Errata of the paper and additions: docs/super-man.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import copysign, cos, isfinite, sin, sqrt
from operator import sub
from typing import Any, ClassVar, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from runtime.contracts import rotation
from runtime.contracts.controller import Controller, ControllerConfig
from runtime.contracts.per_element import Positive
from runtime.contracts.signals import Array, Signal
from runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSE, TWIST, WRENCH
from runtime.control.cobot.axes import MassInertia, OnPlanarTwist, OnTwist
from runtime.control.cobot.guide_buttons import GRIPPER, LOCOMOTION, MODES
from runtime.control.cobot.whole_body import (
    BASE,
    ArmDynamics,
    LoadConfig,
    RobotName,
    add_base,
    jacobian_signal,
    mount_of_the_arm,
)
from runtime.control.robots import ARMS
from runtime.control.shared.priority import Priority
from runtime.control.shared.spd6 import NEAR, Equations

_FIRM: Final = 1e-6 * np.eye(6)  # 1/kg, 1/(kg m^2): makes the mobility invertible in singular postures, too
_SELDOM: Final = 10  # cycles after which the masses are computed again: they change only with the posture
_HEAVIEST: Final = 20.0  # kg, kg m^2: near singular postures the masses grow without bounds
_HELD_BACK: Final = 0.1  # N m: a larger difference of desired and applied torque counts as held back


class MocaPriority(BaseModel):
    """The weights of one priority."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    base: Positive = Field(description="eta_B, how much the base is spared")
    arm: Positive = Field(description="eta_A, how much the arm is spared")
    posture: float = Field(ge=0, allow_inf_nan=False, description="K_0 of each joint, N m/rad")


class MocaImpedanceConfig(RobotName, ControllerConfig):
    """Options of `moca-impedance`."""

    gone: ClassVar[Mapping[str, str]] = {"mount_quaternion": "how the arm stands follows from `frames:`"}

    stiffness: OnTwist = Field((500.0, 500.0, 500.0, 30.0, 30.0, 30.0), description="K_d, N/m and N m/rad, world axes")
    damping_ratio: float = Field(0.7, gt=0, le=2, description="xi; D_d = 2 xi sqrt(K_d m), D_0 = 2 xi sqrt(K_0)")
    unit_mass: bool = Field(
        False, description="m of D_d is 1, as published; else the mass along each axis in this posture, at least 1"
    )
    manipulation: MocaPriority = MocaPriority(base=5.0, arm=1.0, posture=5.0)
    locomotion: MocaPriority = MocaPriority(base=1.0, arm=6.0, posture=50.0)
    blend: float = Field(0.5, gt=0, description="s that a switch of priority takes")
    virtual_mass: MassInertia = Field((105.0, 21.0), description="M_v: kg along x and y, kg m^2")
    base_damping: float = Field(10.0, gt=0, description="D_v over M_v, 1/s")
    base_acceleration: OnPlanarTwist | None = Field(
        None, description="m/s2, m/s2, rad/s2 that it asks of the base; null: unbounded"
    )
    gravity: Literal["robot", "here"] = Field(
        "robot", description="who holds the arm's own weight; `robot`: the torques come on top of the robot's part"
    )
    coriolis: bool = Field(True, description="compensate the arm's Coriolis forces; false where the robot does")
    payload: LoadConfig | None = Field(None, description="what the closed gripper carries")
    payload_time: float = Field(0.3, gt=0, description="s over which the payload comes in and goes")
    lag: float = Field(
        0.003, ge=0, le=0.05, description="s; damping that would overshoot within it is reduced; 0: the paper's"
    )


class WeightedTorque:
    """Eq. 4: the torques that have a given task force F and are otherwise least in the metric W.

    It is written without W^-1, which isn't needed: with y from (J M^-1 H^-2 J^T) y = J M^-1 (J^T F - tau_0),
    tau_c = tau_0 + H^-2 J^T y. M and H commute, so the matrix is symmetric.
    """

    def __init__(self, n: int, virtual_mass: tuple[float, float]) -> None:
        self._m, self._j = 1.0 / virtual_mass[0], 1.0 / virtual_mass[1]
        self._J: Array = np.zeros((6, BASE + n))
        self._B: Array = np.zeros((n, 6))  # M_a^-1 J_a^T
        self._S: Array = np.zeros((6, 6))  # J_a M_a^-1 J_a^T
        self._equations = Equations()
        self.independence = 1.0

    def masses(self) -> list[float]:
        """The diagonal of (J_a M_a^-1 J_a^T)^-1, kg, kg m^2: the mass along each axis while the others are held."""
        found: list[float] = np.linalg.inv(self._S + _FIRM).diagonal().tolist()
        return found

    def mobility(self) -> list[float]:
        """The diagonal of J_a M_a^-1 J_a^T, 1/kg and 1/(kg m^2): acceleration along each axis for a tip force on it."""
        found: list[float] = self._S.diagonal().tolist()
        return found

    def take(self, J: Array, inverse_mass: Array) -> None:
        """Takes J (6, 3 + n) and M_a^-1 (n, n), 1/(kg m^2)."""
        self._J = J
        Ja = J[:, BASE:]
        self._B = inverse_mass.dot(Ja.T)
        self._S = Ja.dot(self._B)

    def __call__(
        self, F: list[float], tau_0: list[float], eta_B: float, eta_A: float
    ) -> tuple[tuple[float, float, float], Array]:
        """tau_v (3,), world axes, and tau_a (n,), N and N m, for F (6,) N, N m; tau_0 (n,) is only the arm's."""
        m, j = self._m, self._j
        u, v = self._J.item(0, 2), self._J.item(1, 2)  # effect of yaw on the control point, m
        w_b, w_a = 1.0 / (eta_B * eta_B), 1.0 / (eta_A * eta_A)
        null = np.array(tau_0)
        A = w_a * self._S
        add_base(A, self._J, w_b * m, w_b * j)
        turn = j * (u * F[0] + v * F[1] + F[5])
        b = self._S.dot(np.array(F))
        b -= null.dot(self._B)
        b += (m * F[0] + u * turn, m * F[1] + v * turn, 0.0, 0.0, 0.0, turn)
        y, self.independence = self._equations.damped(A, b)
        null += w_a * y.dot(self._J[:, BASE:])
        y0, y1, _, _, _, y5 = y.tolist()
        return (w_b * y0, w_b * y1, w_b * (u * y0 + v * y1 + y5)), null


class MocaImpedance(Controller):
    """Weighted whole-body impedance control of an arm on a mobile base.

    Inputs: `q` (n,) rad, `qd` (n,) rad/s; `base_pose` (3,) m and rad; measured `pose` (7,), `twist` (6,) and
    `jacobian` (6, 3 + n) from `tool-pose`; `desired_pose` (7,) m and w x y z, `desired_twist` (6,) m/s and
    rad/s, world; `modes` (4,): -, -, gripper closed, locomotion.

    Outputs: `torque` (n,) N m; `base_twist` (3,) vx, vy (m/s), wz (rad/s) in the base's frame; `force` (6,) N and
    N m, F of eq. 8, world axes.
    """

    Config = MocaImpedanceConfig
    summary = "weighted whole-body impedance: arm in torque, base in velocity (SUPER-MAN eqs. 2-9)"

    def __init__(self, name: str, config: MocaImpedanceConfig) -> None:
        super().__init__(name, config)
        robot = ARMS[config.robot]
        self._n = n = robot.n
        self.inputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=robot.labels),
            Signal(name="qd", shape=(n,), unit="rad/s", labels=robot.labels),
            Signal(name="base_pose", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(name="pose", shape=(7,), unit="m", frame="=base_pose", labels=POSE),
            Signal(name="twist", shape=(6,), unit="m/s, rad/s", frame="=pose", of="=pose", labels=TWIST),
            jacobian_signal(robot, frame="=pose", of="=pose"),
            Signal(name="desired_pose", shape=(7,), unit="m", frame="=pose", of="=pose", labels=POSE),
            Signal(name="desired_twist", shape=(6,), unit="m/s, rad/s", frame="=pose", of="=pose", labels=TWIST),
            Signal(name="modes", shape=(4,), unit="1", labels=MODES),
        )
        self.outputs = (
            Signal(name="torque", shape=(n,), unit="N m", labels=robot.labels),
            Signal(name="base_twist", shape=(3,), unit="m/s, rad/s", labels=PLANAR_TWIST),
            Signal(name="force", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH),
        )
        self._config = config
        self._K = config.stiffness
        self._D = [2 * config.damping_ratio * sqrt(k) for k in config.stiffness]  # for 1 kg, 1 kg m^2
        self._now, self._age = self._D, 0  # D_d of this posture, and the cycles since it was computed
        self._priority = Priority(n, config.blend)
        self._weighted = WeightedTorque(n, config.virtual_mass)
        self.transforms = (mount_of_the_arm(),)  # which way is down
        self._robot = robot
        self._cycles = self._held_back = self._singular = 0
        self._strongest = 0.0

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        payload = None if self._config.payload is None else self._config.payload.payload()
        _, _, _, w, x, y, z = self.transform["mount"].tolist()
        self._dynamics = ArmDynamics(self._robot, payload, (w, x, y, z))

    def reset(self) -> None:
        modes = self.input["modes"]
        self._priority.reset(modes[LOCOMOTION] > 0.5, self.input["q"])
        # Somebody already supports an object that is held now: its weight is added at once, like the arm's.
        self._dynamics.carry(float(modes[GRIPPER] > 0.5))
        self.output["base_twist"][:] = self.applied.get("base_twist", 0.0)
        self._age = 0
        self._step(0.0)

    def update(self, dt: float) -> None:
        self._watch()
        modes = self.input["modes"]
        self._priority.update(modes.item(LOCOMOTION) > 0.5, self.input["q"], dt)
        self._carry(modes.item(GRIPPER) > 0.5, dt)
        self._step(dt)

    def figures(self) -> dict[str, object]:
        """Returns the strongest F, and the shares of cycles with torque held back by the guard and near singularity."""
        cycles = max(self._cycles, 1)
        return {
            "strongest_force_n": self._strongest,
            "held_back": self._held_back / cycles,
            "near_singular": self._singular / cycles,
        }

    def _step(self, dt: float) -> None:
        c, priority = self._config, self._priority
        q, qd = self.input["q"], self.input["qd"]
        inverse_mass = self._dynamics.inverse_mass(q)
        self._weighted.take(self.input["jacobian"], inverse_mass)
        F = self._force()
        tau_0 = self._posture(inverse_mass)
        eta_B = priority.between_ratios(c.manipulation.base, c.locomotion.base)
        eta_A = priority.between_ratios(c.manipulation.arm, c.locomotion.arm)
        tau_v, tau_a = self._weighted(F, tau_0, eta_B, eta_A)
        tau_a += self._dynamics.bias(q, qd, gravity=c.gravity == "here", coriolis=c.coriolis)
        self.output["torque"][:] = tau_a
        self.output["force"][:] = F
        self._move_base(tau_v, dt)
        self._singular += self._weighted.independence < NEAR
        self._strongest = max(self._strongest, sqrt(F[0] * F[0] + F[1] * F[1] + F[2] * F[2]))

    def _force(self) -> list[float]:
        """Eq. 8: F = D_d (xd_d - x_d) + K_d (x_d - x), on SO(3)."""
        x, y, z, *o = self.input["pose"].tolist()
        X, Y, Z, *r = self.input["desired_pose"].tolist()
        turn = rotation.error((r[0], r[1], r[2], r[3]), (o[0], o[1], o[2], o[3]))
        away = (X - x, Y - y, Z - z, *turn)
        v, V = self.input["twist"].tolist(), self.input["desired_twist"].tolist()
        return [K * e + D * (W - w) for K, e, D, W, w in zip(self._K, away, self._damping(), V, v, strict=True)]

    def _damping(self) -> list[float]:
        """D_d of this posture, reduced where it would overshoot within the lag."""
        if self._age == 0:
            D, lag = self._D, self._config.lag
            if not self._config.unit_mass:
                D = [d * sqrt(min(max(m, 1.0), _HEAVIEST)) for d, m in zip(D, self._weighted.masses(), strict=True)]
            self._now = [d / (1.0 + lag * d * s) for d, s in zip(D, self._weighted.mobility(), strict=True)]
            if not isfinite(sum(self._now)):
                return self._now  # from a failed measurement: not kept
        self._age = (self._age + 1) % _SELDOM
        return self._now

    def _posture(self, inverse_mass: Array) -> list[float]:
        """Eq. 9 for the arm: tau_0 = -D_0 qd + K_0 (q_pref - q). The base has no tau_0."""
        c = self._config
        K = self._priority.between(c.manipulation.posture, c.locomotion.posture)
        D, lag = 2 * c.damping_ratio * sqrt(K), c.lag
        q, qd, preferred = self.input["q"].tolist(), self.input["qd"].tolist(), self._priority.preferred.tolist()
        mobility = inverse_mass.diagonal().tolist()
        return [
            K * (p - a) - D / (1.0 + lag * D * s) * w for p, a, w, s in zip(preferred, q, qd, mobility, strict=True)
        ]

    def _move_base(self, tau_v: tuple[float, float, float], dt: float) -> None:
        """Eq. 2: M_v q_b_dd + D_v q_b_d = tau_v, starting from the guarded velocity (`.applied`)."""
        m, j = self._config.virtual_mass
        decay = 1.0 / (1.0 + dt * self._config.base_damping)
        yaw = self.input["base_pose"].item(2)
        c, s = cos(yaw), sin(yaw)
        vx, vy, wz = self.applied.get("base_twist", self.output["base_twist"]).tolist()
        x = decay * (c * vx - s * vy + dt / m * tau_v[0])
        y = decay * (s * vx + c * vy + dt / m * tau_v[1])
        twist = [c * x + s * y, c * y - s * x, decay * (wz + dt / j * tau_v[2])]
        if (most := self._config.base_acceleration) is not None:
            for i, (u, a) in enumerate(zip((vx, vy, wz), most, strict=True)):
                if abs(twist[i] - u) > dt * a:
                    twist[i] = u + copysign(dt * a, twist[i] - u)
        self.output["base_twist"][:] = twist

    def _carry(self, closed: bool, dt: float) -> None:
        dynamics, step = self._dynamics, dt / self._config.payload_time
        dynamics.carry(min(dynamics.load + step, 1.0) if closed else max(dynamics.load - step, 0.0))

    def _watch(self) -> None:
        self._cycles += 1
        applied = self.applied.get("torque")
        if applied is not None:
            changes = map(sub, applied.tolist(), self.output["torque"].tolist())
            self._held_back += max(map(abs, changes)) > _HELD_BACK
