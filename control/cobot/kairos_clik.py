"""Kairos' weighted whole-body closed-loop inverse kinematics (Giammarino et al. 2022, eqs. 10 to 17, appendix B).

It computes velocities of base and arm that follow a desired motion of the tool. w_b and w_a decide which of them
moves. Errata of the paper and additions: docs/super-man.md.
"""

from __future__ import annotations

from math import cos, prod, sin
from typing import Any

import eigenpy
import numpy as np
from pydantic import Field

from srl.control.cobot.axes import OnPlanarTwist, OnTwist
from srl.control.cobot.contact_compliance import ComplianceConfig, ContactCompliance
from srl.control.cobot.guide_buttons import GRIPPER, LOCOMOTION, MODES
from srl.control.cobot.whole_body import BASE, RobotName, add_base, jacobian_signal
from srl.control.shared.priority import Priority
from srl.control.shared.ramp import Ramps, factor
from srl.control.shared.spd6 import Equations
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSE, TWIST, WRENCH
from srl.runtime.models.robot_model import RobotOption, arm_named


class KairosPriority(Options):
    """The weights of one priority."""

    base: Positive = Field(description="w_b, how much the base is spared")
    arm: Positive = Field(description="w_a, how much the arm is spared")
    posture: float = Field(ge=0, allow_inf_nan=False, description="k_i, 1/s, pull to the preferred configuration")


class KairosClikConfig(RobotName, ControllerConfig):
    """Options of `kairos-clik`."""

    robot: RobotOption = arm_named("ur16e")
    gain: OnTwist = Field((0.5, 0.5, 0.5, 0.05, 0.01, 0.01), description="K, 1/s, world axes")
    tracking: OnTwist = Field((1000.0, 1000.0, 1000.0, 500.0, 500.0, 500.0), description="W_1, diagonal")
    damping: float = Field(2.0, ge=0, description="k_0 of eq. 13")
    manipulability: float = Field(0.001, ge=0, description="w_t of eq. 13, below which k grows")
    manipulation: KairosPriority = KairosPriority(base=100.0, arm=1.0, posture=0.0)
    locomotion: KairosPriority = KairosPriority(base=10.0, arm=0.5, posture=1.0)
    blend: float = Field(0.5, ge=0, description="s that a switch of priority takes; 0: at once, as published")
    speed: float | None = Field(
        1.0, gt=0, le=1, description="share of the arm's greatest joint speeds that it asks for; null: unbounded"
    )
    acceleration: float | None = Field(
        None, gt=0, description="rad/s2 asked of each joint at most, all changes held back alike; null: unbounded"
    )
    base_speed: OnPlanarTwist | None = Field(
        None, description="m/s, m/s, rad/s that it asks of the base; null: unbounded"
    )
    base_acceleration: OnPlanarTwist | None = Field(
        None, description="m/s2, m/s2, rad/s2 that it asks of the base, the arm doing the rest; null: unbounded"
    )
    force_feedback: ComplianceConfig | None = Field(None, description="give way to contact; null: the paper's law")


class KairosClik(Controller):
    """Weighted whole-body inverse kinematics of an arm on a mobile base.

    Inputs: `q` (n,) rad; `base_pose` (3,) m and rad; measured `pose` (7,) and `jacobian` (6, 3 + n) from
    `tool-pose`; `desired_pose` (7,) m and w x y z, `desired_twist` (6,) m/s and rad/s, world; `modes`
    (4,): -, -, gripper closed, locomotion. With `force_feedback` also `flange_wrench` (6,) N and N m, and with its
    option `hand` also `hand` (6,) N and N m from the admittance; with `load: identified` there, instead of both,
    `outside` (6,) N and N m from `payload`.

    Outputs: `velocity` (n,) rad/s; `base_twist` (3,) vx, vy (m/s), wz (rad/s) in the base's frame; `manipulability`
    (1,) of the arm, eq. 12. With `force_feedback` also `contact` (6,) N and N m, world axes.
    """

    Config = KairosClikConfig
    c_version = "srl.control.cobot.compiled_kairos:CompiledKairos"
    summary = "weighted whole-body inverse kinematics: arm and base in velocity (SUPER-MAN eqs. 10-17)"

    def __init__(self, name: str, config: KairosClikConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
        n = robot.n
        self.inputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=robot.labels),
            Signal(name="base_pose", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(name="pose", shape=(7,), unit="m", frame="=base_pose", labels=POSE),
            jacobian_signal(robot, frame="=base_pose", of="=pose"),
            Signal(name="desired_pose", shape=(7,), unit="m", frame="=base_pose", of="=pose", labels=POSE),
            Signal(name="desired_twist", shape=(6,), unit="m/s, rad/s", frame="=base_pose", of="=pose", labels=TWIST),
            Signal(name="modes", shape=(4,), unit="1", labels=MODES),
        )
        self.outputs = (
            Signal(name="velocity", shape=(n,), unit="rad/s", labels=robot.labels),
            Signal(name="base_twist", shape=(3,), unit="m/s, rad/s", labels=PLANAR_TWIST),
            Signal(name="manipulability", shape=(1,), unit="1"),
        )
        self._compliance: ContactCompliance | None = None
        self._hand = False
        if config.force_feedback is not None:
            self._compliance = ContactCompliance(config.force_feedback)
            self.transforms = self._compliance.transforms()
            self._hand = self._compliance.hand
            if self._compliance.identified:
                self._wrench = "outside"
                self.inputs += (
                    Signal(name="outside", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH),
                )
            else:
                self._wrench = "flange_wrench"
                self.inputs += (Signal(name="flange_wrench", shape=(6,), unit="N, N m", labels=WRENCH),)
            contact = Signal(name="contact", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH)
            self.outputs += (contact,)
            if self._hand:
                hand = Signal(name="hand", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH)
                self.inputs += (hand,)
        speed = factor("speed", 0.1, 1.0, "multiplies the speed limits")
        self._ramps = Ramps(speed, factor("gain", 0.1, 4.0, "multiplies K"))
        self.parameters = self._ramps.parameters
        self._config = config
        self._priority = Priority(n, config.blend)
        self._fastest = None if config.speed is None else (config.speed * robot.dq_max).tolist()
        self._G: Array = np.zeros((6, 6))  # J_a J_a^T
        self._firm: Array = np.diag(1.0 / np.array(config.tracking))  # W_1^-1
        self._equations = Equations()
        self._triangle = eigenpy.HouseholderQR(n, 6)
        self._turn: rotation.Vector = (0.0, 0.0, 0.0)  # rad, to the desired orientation, without jumps at pi
        self._cycles = self._damped = self._slowed = 0
        self._least = float("inf")

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        if self._compliance is not None:
            self._compliance.place(self.transform)

    def reset(self) -> None:
        modes = self.input["modes"]
        self._priority.reset(modes[LOCOMOTION] > 0.5, self.input["q"])
        if self._compliance is not None:
            self._compliance.reset(bool(modes[GRIPPER] > 0.5))
        self._turn = (0.0, 0.0, 0.0)
        self._ramps.reset(self.param)
        self._step(0.0)

    def update(self, dt: float) -> None:
        self._cycles += 1
        self._ramps.update(self.param, dt)
        self._priority.update(self.input["modes"].item(LOCOMOTION) > 0.5, self.input["q"], dt)
        self._step(dt)

    def metrics(self) -> dict[str, object]:
        """Returns the least manipulability and the shares of cycles near a singular posture and slowed down to limits.

        A cycle is slowed down if a joint or the base would otherwise exceed its speed.
        """
        cycles = max(self._cycles, 1)
        return {
            "least_manipulability": self._least if self._cycles else None,
            "near_singular": self._damped / cycles,
            "slowed": self._slowed / cycles,
        }

    def _step(self, dt: float) -> None:
        c, priority = self._config, self._priority
        J = self.input["jacobian"]
        Ja = J[:, BASE:]
        k = self._damping(Ja)
        # (14) by W_2 instead of J' W_1 J + W_2: (J' W_1 J + W_2)^-1 J' W_1 = W_2^-1 J' (J W_2^-1 J' + W_1^-1)^-1
        w_b = 1.0 / priority.between_ratios(c.manipulation.base, c.locomotion.base)
        w_a = 1.0 / (priority.between_ratios(c.manipulation.arm, c.locomotion.arm) * k * k)
        A = w_a * self._G
        A += self._firm
        add_base(A, J, w_b, w_b)
        task = self._task(dt)
        k_i = priority.between(c.manipulation.posture, c.locomotion.posture)
        if k_i > 0.0:
            second = k_i * (priority.preferred - self.input["q"])  # (17)
            task -= Ja.dot(second)
            y = self._equations.solve(A, task)
            arm = (second + w_a * y.dot(Ja)).tolist()  # (10), N of the same damped inverse
        else:
            y = self._equations.solve(A, task)
            arm = (w_a * y.dot(Ja)).tolist()
        u, v = J.item(0, 2), J.item(1, 2)
        y0, y1, _, _, _, y5 = y.tolist()
        base = self._own_axes(w_b * y0, w_b * y1, w_b * (u * y0 + v * y1 + y5))
        self._send(arm, base, w_a, dt)

    def _send(self, arm: list[float], base: list[float], w_a: float, dt: float) -> None:
        """Fills the outputs. `base` is in its own axes; `w_a` is the arm's part of W_2^-1."""
        arm, base = self._slow_down(arm, base)
        late = self._held_back(base, dt)
        if any(late):
            # The arm makes up for what the base can't do yet: (14) of the arm alone, for the missing motion.
            J = self.input["jacobian"]
            Ja, u, v = J[:, BASE:], J.item(0, 2), J.item(1, 2)
            vx, vy, wz = self._world_axes(late)
            A = w_a * self._G
            A += self._firm
            y = self._equations.solve(A, np.array((vx + u * wz, vy + v * wz, 0.0, 0.0, 0.0, wz)))
            arm = [a + d for a, d in zip(arm, (w_a * y.dot(Ja)).tolist(), strict=True)]
            arm, _ = self._slow_down(arm, [0.0] * BASE)
            base = [a - b for a, b in zip(base, late, strict=True)]
        self.output["velocity"][:] = self._eased(arm, dt)
        self.output["base_twist"][:] = base

    def _eased(self, arm: list[float], dt: float) -> list[float]:
        """Limits the joints' accelerations: near a singular posture, small task changes are large joint changes."""
        most = self._config.acceleration
        if most is None or dt == 0.0:
            return arm
        last = self.applied.get("velocity", self.output["velocity"]).tolist()
        share = max(abs(v - old) for v, old in zip(arm, last, strict=True)) / (most * dt)
        return arm if share <= 1.0 else [old + (v - old) / share for v, old in zip(arm, last, strict=True)]

    def _damping(self, Ja: Array) -> float:
        """k of eq. 13, from the arm's manipulability of eq. 12."""
        c = self._config
        np.dot(Ja, Ja.T, self._G)
        # By R of J_a^T = Q R: the determinant itself loses half of the digits near zero, where k changes.
        self._triangle.compute(Ja.T)
        w = abs(prod(self._triangle.matrixQR().diagonal().tolist())) if Ja.shape[1] >= len(Ja) else 0.0
        self.output["manipulability"][0] = w
        self._least = min(self._least, w)
        if w >= c.manipulability:
            return 1.0
        self._damped += 1
        away = 1.0 - w / c.manipulability
        return 1.0 + c.damping * away * away

    def _task(self, dt: float) -> Array:
        """xd_d + K (x_d - x) (6,), for the desired motion after it has yielded to contact."""
        x, y, z, *o = self.input["pose"].tolist()
        X, Y, Z, *r = self.input["desired_pose"].tolist()
        twist = self.input["desired_twist"].tolist()
        actual: rotation.Quaternion = (o[0], o[1], o[2], o[3])
        desired: rotation.Quaternion = (r[0], r[1], r[2], r[3])
        compliance = self._compliance
        if compliance is not None:
            # The desired pose is rotated by the deviation e, so its angular velocity is rotated, too.
            w = rotation.turned(rotation.exp(*compliance.deviation[3:]), (twist[3], twist[4], twist[5]))
            twist = [*twist[:3], *w]
            compliance.update(
                self.input[self._wrench].tolist(),
                self.input["hand"].tolist() if self._hand else [0.0] * 6,
                twist,
                actual,
                self.input["base_pose"].item(2),
                self.input["modes"].item(GRIPPER) > 0.5,
                dt,
            )
            self.output["contact"][:] = compliance.contact
            e = compliance.deviation
            X, Y, Z = X + e[0], Y + e[1], Z + e[2]
            desired = rotation.product(rotation.exp(e[3], e[4], e[5]), desired)
            twist = [a + b for a, b in zip(twist, compliance.velocity, strict=True)]
        self._turn = rotation.log_nearest(rotation.product(desired, rotation.conjugate(actual)), self._turn)
        away = (X - x, Y - y, Z - z, *self._turn)
        k = self._ramps.values["gain"]
        return np.array([v + k * K * e for v, K, e in zip(twist, self._config.gain, away, strict=True)])

    def _own_axes(self, vx: float, vy: float, wz: float) -> list[float]:
        """Converts a twist of the base (3,) from world axes to its own axes."""
        yaw = self.input["base_pose"].item(2)
        c, s = cos(yaw), sin(yaw)
        return [c * vx + s * vy, c * vy - s * vx, wz]

    def _world_axes(self, twist: list[float]) -> tuple[float, float, float]:
        yaw = self.input["base_pose"].item(2)
        c, s = cos(yaw), sin(yaw)
        return c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]

    def _slow_down(self, arm: list[float], base: list[float]) -> tuple[list[float], list[float]]:
        """Scales all velocities alike if one would be too fast, which keeps the direction."""
        share, k = 1.0, self._ramps.values["speed"]
        if self._fastest is not None:
            share = max(share, *[abs(v) / (k * V) for v, V in zip(arm, self._fastest, strict=True)])
        if self._config.base_speed is not None:
            share = max(share, *[abs(v) / (k * V) for v, V in zip(base, self._config.base_speed, strict=True)])
        if share == 1.0:
            return arm, base
        self._slowed += 1
        return [v / share for v in arm], [v / share for v in base]

    def _held_back(self, base: list[float], dt: float) -> list[float]:
        """The part of the base's twist (own axes) beyond its acceleration limit, from the last guarded command."""
        most = self._config.base_acceleration
        if most is None:
            return []
        last = self.applied.get("base_twist", self.output["base_twist"]).tolist()
        return [v - min(max(v, old - dt * a), old + dt * a) for v, old, a in zip(base, last, most, strict=True)]
