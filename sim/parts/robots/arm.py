"""An arm with its drives: torque with gravity compensation, velocity loop, position servo, brakes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final, Literal, cast, get_args
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
import pinocchio as pin
from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.robots import Payload, RobotDescription
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.sim.parts.robots.guided import Guided
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig
from srl.sim.world.robot_mjcf import SPECK, add_arm

Mode = Literal["brake", "torque", "velocity", "position"]
_MODES: Final[tuple[Mode, ...]] = get_args(Mode)
_NONE: Final = np.zeros(3)
_OUTSIDE: Final = ("EQUALITY", "CONTACT_FRICTIONLESS", "CONTACT_PYRAMIDAL", "CONTACT_ELLIPTIC")
# By mjtConstraint: external forces, so neither end stops nor the joints' own friction.
_EXTERNAL: Final = np.isin(range(8), [int(getattr(mujoco.mjtConstraint, f"mjCNSTR_{name}")) for name in _OUTSIDE])


HOME: Final[Any] = Field(default=None, description="rad, at the start, of each joint; null: the robot's own")


class PayloadConfig(BaseModel):
    """The payload at the flange that is set in the arm's controller."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mass: float = Field(default=0.0, ge=0, description="kg")
    com: Annotated[tuple[Finite, Finite, Finite], PerElement(POINT)] = Field(
        default=(0.0, 0.0, 0.0), description="m, centre of mass, flange frame"
    )


class ArmConfig(PartConfig):
    """Options of an arm."""

    renamed: ClassVar[dict[str, str]] = {"told_payload": "declared_payload"}

    home: tuple[Finite, ...] | None = HOME  # an arm's own options give it the names of its joints
    declared_payload: PayloadConfig = Field(
        default=PayloadConfig(), description="what gravity compensation reckons with besides the arm"
    )
    damping: float = Field(default=0.1, ge=0, description="N m s/rad of each joint")
    friction: float = Field(
        default=0.0, ge=0, le=1, description="share of the joints' friction that the robot doesn't compensate"
    )
    guided: bool = Field(default=False, description="a person leads it by hand, as a calibration says")
    drives: float = Field(
        default=1.0, gt=0, le=100, description="stiffness in velocity and position mode, times the robot's own"
    )


class ArmPart(Part):
    """A serial arm. Its frames are those of the robot's description.

    Drives give at most the joint's greatest torque, gravity compensation included. In velocity and position mode
    they are springs and dampers of finite stiffness about a reference. In velocity mode the reference advances with
    the commanded velocity, but no further ahead than the greatest torque stretches the spring. Brakes are such a
    spring that slips at the greatest torque.

    Attributes:
        robot: its description.
        n: number of joints.
        labels: names of the joints.
        home: (n,) rad, start position.
        mode: the drives' present mode.
        declared: the payload used for gravity compensation.
    """

    Config: ClassVar[type[PartConfig]] = ArmConfig
    robot: ClassVar[RobotDescription]

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(ArmConfig, config)
        self.n, self.labels = n, labels = self.robot.n, self.robot.labels
        self.home = np.array(self.robot.home if config.home is None else config.home, dtype=float)
        if self.home.shape != (n,) or np.any(self.home < self.robot.q_lower) or np.any(self.home > self.robot.q_upper):
            raise WiringError(
                f"sim.parts.{name}.home",
                f"{n} joint angles within the limits of {self.robot.name} are needed, got {self.home.tolist()}",
                "Give one in rad for each of " + ", ".join(labels),
            )
        self.truth = (
            Signal(name=f"{name}_position", shape=(n,), unit="rad", labels=labels),
            Signal(name=f"{name}_velocity", shape=(n,), unit="rad/s", labels=labels),
            Signal(name=f"{name}_effort", shape=(n,), unit="N m", labels=labels),
            Signal(name=f"{name}_external_effort", shape=(n,), unit="N m", labels=labels),
            Signal(name=f"{name}_flange", shape=(3,), unit="m", labels=POINT),
            Signal(
                name=f"{name}_links",
                shape=(n + 2, 3),
                unit="m",
                labels=("base", *labels, "flange"),
                components=(POINT,),
                visual="robot",
                links=(tuple(range(n + 2)),),
            ),
        )
        self.every = 1
        self.wearer = Guided(self.robot, self.home, seed) if config.guided else None
        self.mode: Mode = "brake"
        self._gain = config.drives * np.array(self.robot.stiffness)
        self._damping = 2 * np.sqrt(self._gain * self.robot.inertia)
        self._sliding = self.robot.sliding_friction if config.friction else None
        self._torques = np.stack((-self.robot.tau_max, self.robot.tau_max), axis=1)  # (n, 2): least, greatest
        self._leash = self.robot.tau_max / self._gain
        self._reference, self._rate = self.home.copy(), np.zeros(n)
        self._scratch = np.zeros(n)
        self._settled_at = self._measured_at = -1.0
        self._placed: tuple[Array, Array] | None = None  # `flange` at `_settled_at`
        self._measured = np.zeros(2 * n + 6)  # effort, external effort, flange wrench
        self._mounted = 0.0, np.zeros(3)  # kg and N, of what is at the flange

    # -- construction

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        flange = add_arm(mjcf, parent, self.robot, name, config.damping, config.friction, **self.at())
        add(flange, "site", name=f"{name}/flange", size=0.005)
        for kind in ("force", "torque"):
            add(mjcf.sensor, kind, name=f"{name}/{kind}", site=f"{name}/flange")
        # MuJoCo can lift a body by a multiple of its weight, so a tiny body can compensate the payload that was set.
        speck = add(flange, "body", name=f"{name}/told_payload", gravcomp=1)
        add(speck, "inertial", pos=(0, 0, 0), mass=SPECK, diaginertia=(SPECK, SPECK, SPECK))

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        first = model.joint(f"{self.name}/{self.labels[0]}")
        angles = slice(int(first.qposadr[0]), int(first.qposadr[0]) + self.n)
        self._dofs = dofs = slice(int(first.dofadr[0]), int(first.dofadr[0]) + self.n)
        drive = int(model.actuator(f"{self.name}/{self.labels[0]}").id)
        drives = slice(drive, drive + self.n)
        self._q, self._dq, self._ctrl = data.qpos[angles], data.qvel[dofs], data.ctrl[drives]
        self._drag = model.dof_damping[dofs]
        self._bias, self._drive_effort = model.actuator_biasprm[drives], data.qfrc_actuator[dofs]
        self._held_column, self._range = data.qfrc_gravcomp[dofs, None], model.actuator_forcerange[drives]
        # Views that are cheaper to keep than to ask for in every step.
        self._applied, self._pushes, self._middles = data.qfrc_applied, data.xfrc_applied, data.xipos
        self._all_pushes, self._places = self._pushes.reshape(-1), data.xpos
        self._subtrees, self._subtree_masses = data.subtree_com, model.body_subtreemass
        self._base = int(model.body(f"{self.name}/base").id)
        chain = ("base", *self.labels, "flange")
        self._chain = np.array([int(model.body(f"{self.name}/{name}").id) for name in chain])
        self._flange = int(model.body(f"{self.name}/flange").id)
        self._speck = int(model.body(f"{self.name}/told_payload").id)
        sensor = int(model.sensor(f"{self.name}/force").adr[0])
        self._sensor = data.sensordata[sensor : sensor + 6]
        self._q[:] = self.home
        self._full = np.zeros((6, model.nv))
        self._timestep = float(model.opt.timestep)
        self._gravity = np.array(model.opt.gravity)
        declared = self._config.declared_payload
        self.tell_payload(declared.mass, declared.com)
        self._engage()

    def drive(self, step: int) -> None:
        if self.wearer is not None:
            self.command("position", self.wearer.at((step + 1) * self._timestep))
        if self._sliding is not None:
            # As damping of this step's speed: MuJoCo integrates damping implicitly, so that it never drives.
            np.multiply(self._config.friction, self._sliding.damping(self._dq), out=self._drag)
            if self._config.damping:
                self._drag += self._config.damping
        # A drive at its limit has no damping; MuJoCo must know which drives are at it, gravity compensation included.
        np.subtract(self._torques, self._held_column, out=self._range)
        if self.mode in ("velocity", "brake"):
            reference, scratch = self._reference, self._scratch
            np.multiply(self._rate, self._timestep, out=scratch)
            reference += scratch
            np.subtract(reference, self._q, out=scratch)
            np.maximum(scratch, -self._leash, out=scratch)
            np.minimum(scratch, self._leash, out=scratch)
            np.add(self._q, scratch, out=reference)
            self._aim()

    # -- commands

    def command(self, mode: Mode, values: Array | None = None, rates: Array | None = None) -> None:
        """Commands the drives from the next physics step on.

        Args:
            mode: "brake": locked; "torque": N m, on top of gravity compensation; "velocity": rad/s; "position": rad.
            values: (n,); ignored for "brake".
            rates: (n,) rad/s, velocity of the target of "position". Without it the servo lags behind a moving target,
                as a servo does.
        """
        changed = mode != self.mode
        self.mode = mode
        if mode == "torque":
            if changed:
                self._engage()
            self._ctrl[:] = values
            return
        if changed and mode != "position":
            self._reference[:] = self._q
        if mode == "position":
            self._reference[:] = values
            self._rate[:] = 0.0 if rates is None else rates
        else:
            self._rate[:] = 0.0 if mode == "brake" else values
        if changed:
            self._engage()
        else:
            self._aim()

    def tell_payload(self, mass: float, com: tuple[float, float, float] | Array) -> None:
        """Sets the payload in the arm's controller: kg, and its centre of mass in the flange frame, m."""
        x, y, z = (float(v) for v in com)
        self.declared = Payload(float(mass), (x, y, z))
        self._model.body_gravcomp[self._speck] = mass / SPECK
        self._model.body_ipos[self._speck] = x, y, z
        self._declared_weight = -self.declared.mass * self._gravity
        self._known = pinocchio_model(self.robot, payload=self.declared, rotors=True)
        self._known_data = self._known.createData()

    # -- state; all of the world's present instant; effort and wrench are of the step that led to it

    @property
    def position(self) -> Array:
        """(n,) rad."""
        return cast(Array, self._q.copy())

    @property
    def velocity(self) -> Array:
        """(n,) rad/s."""
        return cast(Array, self._dq.copy())

    def measured(self, out: Array) -> None:
        """Fills `out` (4, n) with `position`, `velocity`, `effort` and `external_effort`."""
        out[0], out[1] = self._q, self._dq
        out[2:] = self._measure()[: 2 * self.n].reshape(2, self.n)

    @property
    def effort(self) -> Array:
        """(n,) N m, torque of the drives and brakes, gravity compensation included."""
        return self._measure()[: self.n].copy()

    @property
    def external_effort(self) -> Array:
        """(n,) N m, torques from outside: contacts, applied forces, and the weight that wasn't set as payload.

        A tool's inertia isn't included. A payload that is set but isn't there counts negative.
        """
        return self._measure()[self.n : 2 * self.n].copy()

    def flange_wrench(self) -> Array:
        """(6,) N, N m, the wrench on the flange from what is mounted on it, in the flange frame.

        It contains the weight and the inertia of everything mounted, and the contact forces on it.
        """
        return self._measure()[2 * self.n :].copy()

    def gravity(self) -> Array:
        """(n,) N m that hold the arm and the payload that was set against gravity."""
        self._settle()
        self._known.gravity.linear = self._data.xmat[self._base].reshape(3, 3).T @ self._gravity
        return np.array(pin.computeGeneralizedGravity(self._known, self._known_data, self._q))

    def mass_matrix(self) -> Array:
        """(n, n) kg m^2, of the arm, its rotors and everything actually mounted."""
        self._settle()
        mujoco.mj_crb(self._model, self._data)
        if hasattr(mujoco, "mj_makeM"):
            mujoco.mj_makeM(self._model, self._data)
        unit, column, matrix = np.zeros(self._model.nv), np.zeros(self._model.nv), np.empty((self.n, self.n))
        for i, dof in enumerate(range(self._dofs.start, self._dofs.stop)):
            unit[dof] = 1.0
            mujoco.mj_mulM(self._model, self._data, column, unit)
            matrix[:, i] = column[self._dofs]
            unit[dof] = 0.0
        return matrix

    def flange(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and origin (3,), m, of the flange in the arm's base frame; not to be written to."""
        self._settle()
        if self._placed is None:
            data, base = self._data, self._data.xmat[self._base].reshape(3, 3)
            turn = base.T @ data.xmat[self._flange].reshape(3, 3)
            self._placed = turn, base.T @ (data.xpos[self._flange] - data.xpos[self._base])
            for values in self._placed:
                values.flags.writeable = False
        return self._placed

    def down(self) -> Array:
        """Gravity's acceleration (3,), m/s^2, in the arm's base frame."""
        turned: Array = self._data.xmat[self._base].reshape(3, 3).T @ self._gravity
        return turned

    def jacobian(self) -> Array:
        """(6, n): flange twist v, w in the base frame for joint velocities."""
        self._settle()
        full = self._full
        mujoco.mj_jacBody(self._model, self._data, full[:3], full[3:], self._flange)
        base, own = self._data.xmat[self._base].reshape(3, 3).T, full[:, self._dofs]
        return np.concatenate([base @ own[:3], base @ own[3:]])

    def flange_twist(self) -> Array:
        """(6,) m/s, rad/s, velocity of the flange's origin and angular velocity, relative to and in the base frame."""
        return cast(Array, self.jacobian() @ self._dq)

    def fill(self, truth: Mapping[str, Array]) -> None:
        name, measured, n = self.name, self._measure(), self.n
        position, velocity, effort, external, flange, _ = self.setters(truth)
        position(*self._q.tolist())
        velocity(*self._dq.tolist())
        effort(*measured[:n].tolist())
        external(*measured[n : 2 * n].tolist())
        flange(*self._places[self._flange].tolist())
        self._places.take(self._chain, 0, truth[f"{name}_links"], "clip")

    def save(self) -> Array:
        declared = (self.declared.mass, *self.declared.com)
        head = np.array([float(_MODES.index(self.mode)), *declared])
        own = self.wearer.save() if self.wearer is not None else np.empty(0)
        return np.concatenate([head, self._reference, self._rate, self._measure(), own])

    def restore(self, state: Array) -> None:
        n = self.n
        head, reference, rate, measured, own = np.split(state, [5, 5 + n, 5 + 2 * n, 11 + 4 * n])
        if self.wearer is not None:
            self.wearer.restore(own)
        self.mode = _MODES[int(head[0])]
        self.tell_payload(float(head[1]), head[2:])
        self._reference[:], self._rate[:], self._measured[:] = reference, rate, measured
        self._measured_at, self._settled_at = float(self._data.time), -1.0
        asked = self._ctrl.copy()
        self._engage()
        self._ctrl[:] = asked

    # -- internals

    def _engage(self) -> None:
        """Sets the drives' gains for their mode."""
        if self.mode == "torque":
            self._bias[:, 1:3] = 0.0
            self._ctrl[:] = 0.0
        else:
            self._bias[:, 1], self._bias[:, 2] = -self._gain, -self._damping
            self._aim()

    def _aim(self) -> None:
        np.multiply(self._damping, self._rate, out=self._ctrl)
        np.multiply(self._gain, self._reference, out=self._scratch)
        self._ctrl += self._scratch

    def _settle(self) -> None:
        """Updates bodies: after a step they are one step behind the joints."""
        time = self._data.time
        if self._settled_at != time:
            if self.settled[0] != time:
                mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_comPos(self._model, self._data)
            self._settled_at, self._placed = time, None

    def _measure(self) -> Array:
        """(2 n + 6,) effort, external effort, flange wrench; computed once for each instant."""
        if self._measured_at != self._data.time:
            self._settle()
            n, out = self.n, self._measured
            out[:n] = self._drive_effort
            out[n : 2 * n] = self._external()
            np.negative(self._sensor, out=out[2 * n :])  # MuJoCo gives the wrench of the flange on its load
            self._measured_at = float(self._data.time)
        return self._measured

    def _external(self) -> Array:
        model, data, flange = self._model, self._data, self._flange
        total = self._applied.copy()
        if data.nefc and (data.ncon or data.ne):
            forces = data.efc_force * _EXTERNAL[data.efc_type]
            through = np.zeros(model.nv)
            mujoco.mj_mulJacTVec(model, data, through, forces)
            total += through
        for body in dict.fromkeys(i // 6 for i in self._all_pushes.nonzero()[0].tolist()):
            wrench = self._pushes[body]
            mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], self._middles[body], body, total)
        mounted = self._subtree_masses.item(flange)
        if mounted > 3 * SPECK or self.declared.mass:
            if mounted != self._mounted[0]:
                self._mounted = mounted, mounted * self._gravity
            weight, declared = self._mounted[1], self._declared_weight
            mujoco.mj_applyFT(model, data, weight, _NONE, self._subtrees[flange], flange, total)
            mujoco.mj_applyFT(model, data, declared, _NONE, self._middles[self._speck], flange, total)
        return cast(Array, total[self._dofs])
