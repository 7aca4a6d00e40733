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

import eigenpy
import numpy as np
from pydantic import Field

from srl.control.cobot.axes import MassInertia, OnPlanarTwist, OnTwist
from srl.control.cobot.guide_buttons import GRIPPER, LOCOMOTION, MODES
from srl.control.cobot.whole_body import (
    BASE,
    ArmDynamics,
    LoadConfig,
    RobotName,
    add_base,
    jacobian_signal,
    mount_of_the_arm,
)
from srl.control.shared.priority import Priority
from srl.control.shared.ramp import Ramps, factor
from srl.control.shared.spd6 import NEAR, Equations
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSE, TWIST, WRENCH
from srl.runtime.models.robot_model import WeighedRobot, arm_named

_SELDOM: Final = 10  # cycles after which D_d is computed again: it changes only with the posture
_SLOWEST: Final = 1.0  # rad/s: near singular postures a mode's mass grows without bounds, and its frequency falls
_DROPPED: Final = 0.03  # s over which the weight of an identified load of the robot's whole payload goes
_LIGHT: Final = 1e-3  # kg, below which there is no load
_LEVER: Final = 0.3  # m, by which changes of a load's first moment compare with changes of its mass
_HELD_BACK: Final = 0.1  # N m: a larger difference of desired and applied torque counts as held back

Rotors = Literal["none", "damping", "all"]
_Planar = tuple[float, float, float]


class MocaPriority(Options):
    """The weights of one priority."""

    base: Positive = Field(description="eta_B, how much the base is spared")
    arm: Positive = Field(description="eta_A, how much the arm is spared")
    posture: float = Field(ge=0, allow_inf_nan=False, description="K_0 of each joint, N m/rad")


class MocaImpedanceConfig(RobotName, ControllerConfig):
    """Options of `moca-impedance`."""

    gone: ClassVar[Mapping[str, str]] = {"mount_quaternion": "how the arm stands follows from `frames:`"}

    robot: WeighedRobot = arm_named("panda")
    stiffness: OnTwist = Field((500.0, 500.0, 500.0, 30.0, 30.0, 30.0), description="K_d, N/m and N m/rad, world axes")
    damping_ratio: float = Field(
        0.7, gt=0, le=2, description="xi, of each mode of K_d and the moved mass; D_0 = 2 xi sqrt(K_0)"
    )
    unit_mass: bool = Field(False, description="D_d = 2 xi sqrt(K_d), as published: xi is only that of unit masses")
    rotors: Rotors = Field(
        "damping", description="where the law counts the rotors' inertia: nowhere, as published; in D_d; in M, too"
    )
    manipulation: MocaPriority = MocaPriority(base=5.0, arm=1.0, posture=5.0)
    locomotion: MocaPriority = MocaPriority(base=1.0, arm=6.0, posture=50.0)
    blend: float = Field(0.5, ge=0, description="s that a switch of priority takes; 0: at once, as published")
    virtual_mass: MassInertia = Field((105.0, 21.0), description="M_v: kg along x and y, kg m^2")
    base_damping: float = Field(10.0, gt=0, description="D_v over M_v, 1/s")
    base_acceleration: OnPlanarTwist | None = Field(
        None, description="m/s2, m/s2, rad/s2 that it asks of the base; null: unbounded"
    )
    gravity: Literal["robot", "here"] = Field(
        "robot", description="who holds the arm's own weight; `robot`: the torques come on top of the robot's part"
    )
    coriolis: bool = Field(True, description="compensate the arm's Coriolis forces; false where the robot does")
    payload: LoadConfig | Literal["identified"] | None = Field(
        None, description="what the closed gripper carries; or `identified`, by the law `payload`: input `load`"
    )
    payload_time: float = Field(
        0.3, gt=0, description="s over which the payload comes in and goes; an identified one that is gone goes at once"
    )


class ModalDamping:
    """D_d of eq. 8 that gives each mode of Lambda x_dd + D_d x_d + K_d x = 0 the same damping ratio.

    One factorisation does for both matrices: K_d v = w^2 Lambda v. With R = sqrt(K_d), which is diagonal, the w^2 are
    the eigenvalues of R Lambda^-1 R = U w^2 U^T, and D_d = 2 xi R U w^-1 U^T R. Lambda^-1 itself is not inverted.
    (Albu-Schaeffer et al. 2003, ICRA, "Cartesian impedance control of redundant robots", double diagonalisation.)
    """

    def __init__(self, stiffness: tuple[float, ...], ratio: float) -> None:
        """stiffness: (6,) N/m, N m/rad."""
        self._root = np.sqrt(np.array(stiffness))
        self._ratio = ratio
        self._modes = eigenpy.SelfAdjointEigenSolver(6)

    def __call__(self, mobility: Array) -> Array:
        """D_d (6, 6), N s/m, N m s/rad, for Lambda^-1 (6, 6), 1/kg, 1/(kg m^2), of which the lower triangle counts."""
        root = self._root
        self._modes.compute(root * mobility * root[:, None])
        squares = np.maximum(self._modes.eigenvalues(), _SLOWEST * _SLOWEST)
        shapes = self._modes.eigenvectors() * root[:, None]
        found: Array = (2 * self._ratio * shapes / np.sqrt(squares)).dot(shapes.T)
        return found


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

    def mobility(self, inverse_mass: Array) -> Array:
        """Lambda^-1 = J M^-1 J^T of eq. 5 (6, 6), 1/kg and 1/(kg m^2), for M_a^-1 (n, n), 1/(kg m^2).

        Only the lower triangle is complete.
        """
        Ja = self._J[:, BASE:]
        found: Array = Ja.dot(inverse_mass).dot(Ja.T)
        add_base(found, self._J, self._m, self._j)
        return found

    def take(self, J: Array, inverse_mass: Array) -> None:
        """Takes J (6, 3 + n) and M_a^-1 (n, n), 1/(kg m^2)."""
        self._J = J
        Ja = J[:, BASE:]
        self._B = inverse_mass.dot(Ja.T)
        self._S = Ja.dot(self._B)

    def __call__(self, F: list[float], tau_0: list[float], eta_B: float, eta_A: float) -> tuple[_Planar, Array]:
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
    rad/s, world; `modes` (4,): -, -, gripper closed, locomotion. With `payload: identified` also `load` (4,), kg and m.

    Outputs: `torque` (n,) N m; `base_twist` (3,) vx, vy (m/s), wz (rad/s) in the base's frame; `force` (6,) N and
    N m, F of eq. 8, world axes.
    """

    Config = MocaImpedanceConfig
    c_version = "srl.control.cobot.compiled_moca:CompiledMoca"
    summary = "weighted whole-body impedance: arm in torque, base in velocity (SUPER-MAN eqs. 2-9)"

    def __init__(self, name: str, config: MocaImpedanceConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
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
        self._identified = config.payload == "identified"
        if self._identified:
            self.inputs += (Signal(name="load", shape=(4,), unit="kg, m", labels=("mass", "x", "y", "z")),)
        self._held = [0.0] * 4  # mass and first moment of an identified load
        stiffness = factor("stiffness", 0.2, 1.5, "multiplies K_d, and D_d by its root")
        self._ramps = Ramps(stiffness, factor("damping", 0.5, 1.5, "multiplies D_d"))
        self.parameters = self._ramps.parameters
        self._config = config
        self._K = config.stiffness
        self._D: Array = np.diag([2 * config.damping_ratio * sqrt(k) for k in config.stiffness])  # for 1 kg, 1 kg m^2
        self._modal = None if config.unit_mass else ModalDamping(config.stiffness, config.damping_ratio)
        self._age = 0  # cycles since D_d was computed
        self._priority = Priority(n, config.blend)
        self._weighted = WeightedTorque(n, config.virtual_mass)
        self.transforms = (mount_of_the_arm(),)  # which way is down
        self._robot = robot
        self._turn: rotation.Vector = (0.0, 0.0, 0.0)  # rad, to the desired orientation, without jumps at pi
        self._cycles = self._held_back = self._singular = 0
        self._strongest = 0.0

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        entry = self._config.payload
        payload = entry.payload() if isinstance(entry, LoadConfig) else None
        _, _, _, w, x, y, z = self.transform["mount"].tolist()
        upright, rotors = (w, x, y, z), self._config.rotors
        self._dynamics = ArmDynamics(self._robot, payload, upright, rotors=rotors == "all")
        self._moved = ArmDynamics(self._robot, payload, upright, rotors=True) if rotors == "damping" else None

    def reset(self) -> None:
        modes = self.input["modes"]
        self._priority.reset(modes[LOCOMOTION] > 0.5, self.input["q"])
        # Somebody already supports an object that is held now: its weight is added at once, like the arm's.
        self._held = [0.0] * 4
        if self._identified:
            self._hold(0.0)
        else:
            self._bear(float(modes[GRIPPER] > 0.5))
        self.output["base_twist"][:] = self.applied.get("base_twist", 0.0)
        self._age = 0
        self._turn = (0.0, 0.0, 0.0)
        self._ramps.reset(self.param)
        self._step(0.0)

    def update(self, dt: float) -> None:
        self._watch()
        modes = self.input["modes"]
        self._priority.update(modes.item(LOCOMOTION) > 0.5, self.input["q"], dt)
        self._carry(modes.item(GRIPPER) > 0.5, dt)
        self._ramps.update(self.param, dt)
        self._step(dt)

    def metrics(self) -> dict[str, object]:
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
        F = self._force(inverse_mass)
        eta = (
            priority.between_ratios(c.manipulation.base, c.locomotion.base),
            priority.between_ratios(c.manipulation.arm, c.locomotion.arm),
        )
        tau_v, tau_a = self._weighted(F, self._posture(), *eta)
        bias = self._dynamics.bias(q, qd, gravity=c.gravity == "here", coriolis=c.coriolis)
        tau_v, tau_a = self._within(tau_v, tau_a, bias, inverse_mass, eta, dt)
        self.output["torque"][:] = tau_a + bias
        self.output["force"][:] = F
        self._move_base(tau_v, dt)
        self._singular += self._weighted.independence < NEAR
        self._strongest = max(self._strongest, sqrt(F[0] * F[0] + F[1] * F[1] + F[2] * F[2]))

    def _within(
        self, tau_v: _Planar, tau_a: Array, bias: Array, inverse_mass: Array, eta: tuple[float, float], dt: float
    ) -> tuple[_Planar, Array]:
        """The torques as they are commanded: tau_v (3,), world axes, and tau_a (n,), without the bias (n,).

        `inverse_mass`: M_a^-1 (n, n) of eq. 4; `eta`: eta_B and eta_A of eq. 6.
        """
        return tau_v, tau_a

    def _force(self, inverse_mass: Array) -> list[float]:
        """Eq. 8: F = D_d (xd_d - x_d) + K_d (x_d - x), on SO(3)."""
        x, y, z, *o = self.input["pose"].tolist()
        X, Y, Z, *r = self.input["desired_pose"].tolist()
        turn = rotation.product((r[0], r[1], r[2], r[3]), rotation.conjugate((o[0], o[1], o[2], o[3])))
        self._turn = rotation.log_nearest(turn, self._turn)
        away = (X - x, Y - y, Z - z, *self._turn)
        damped = self._damping(inverse_mass).dot(self.input["desired_twist"] - self.input["twist"]).tolist()
        # All of K_d changes alike, so D_d stays the one of the same modal ratio.
        k = self._ramps.values["stiffness"]
        d = self._ramps.values["damping"] * sqrt(k)
        return [k * K * e + d * D for K, e, D in zip(self._K, away, damped, strict=True)]

    def _inverse_moved(self, inverse_mass: Array) -> Array:
        """M_a^-1 (n, n) of what the torques move, rotors included if they count at all; `inverse_mass`: of eq. 4."""
        return inverse_mass if self._moved is None else self._moved.inverse_mass(self.input["q"])

    def _damping(self, inverse_mass: Array) -> Array:
        """D_d (6, 6) of this posture."""
        if self._modal is None:
            return self._D
        if self._age == 0:
            mobility = self._weighted.mobility(self._inverse_moved(inverse_mass))
            if not np.isfinite(mobility).all():
                return np.full((6, 6), np.nan)  # from a failed measurement: not kept
            self._D = self._modal(mobility)
        self._age = (self._age + 1) % _SELDOM
        return self._D

    def _posture(self) -> list[float]:
        """Eq. 9 for the arm: tau_0 = -D_0 qd + K_0 (q_pref - q). The base has no tau_0."""
        c = self._config
        K = self._priority.between(c.manipulation.posture, c.locomotion.posture)
        D = 2 * c.damping_ratio * sqrt(K)
        q, qd, preferred = self.input["q"].tolist(), self.input["qd"].tolist(), self._priority.preferred.tolist()
        return [K * (p - a) - D * w for p, a, w in zip(preferred, q, qd, strict=True)]

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
        if self._identified:
            self._hold(dt)
            return
        load, step = self._dynamics.load, dt / self._config.payload_time
        self._bear(min(load + step, 1.0) if closed else max(load - step, 0.0))

    def _bear(self, share: float) -> None:
        self._dynamics.carry(share)
        if self._moved is not None:
            self._moved.carry(share)

    def _hold(self, dt: float) -> None:
        """Includes the identified load, without a step, but at once at a reset (dt = 0): somebody supports it then."""
        mass, *com = self.input["load"].tolist()
        if not isfinite(mass + sum(com)):
            return  # its law has refused a measurement: what it said before stands
        change = [a - b for a, b in zip((mass, *(mass * c for c in com)), self._held, strict=True)]
        if dt > 0.0:
            m, x, y, z = change
            time = self._config.payload_time if m > 0.0 else min(_DROPPED, self._config.payload_time)
            most, size = dt / time * self._robot.payload, max(abs(m), sqrt(x * x + y * y + z * z) / _LEVER)
            if size > most:
                change = [most / size * v for v in change]
        self._held = [a + b for a, b in zip(self._held, change, strict=True)]
        m, x, y, z = self._held
        m, centre = (m, (x / m, y / m, z / m)) if m >= _LIGHT else (0.0, (0.0, 0.0, 0.0))
        for dynamics in (self._dynamics, self._moved):
            if dynamics is not None:
                dynamics.hang(m, centre)

    def _watch(self) -> None:
        self._cycles += 1
        applied = self.applied.get("torque")
        if applied is not None:
            changes = map(sub, applied.tolist(), self.output["torque"].tolist())
            self._held_back += max(map(abs, changes)) > _HELD_BACK
