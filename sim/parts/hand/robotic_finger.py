"""The cell's part `robotic-finger`: a finger of hobby servos that somebody wears."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan
from typing import Any, ClassVar, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.models.models import FingerOption, named
from srl.sim.parts.hand.finger import add_finger
from srl.sim.parts.hand.servo import ServoBank, ServoConfig
from srl.sim.world.part import Mjcf, Part, PartConfig


class RoboticFingerConfig(PartConfig):
    """Options of a finger. It stands with its base: x is the straight finger, z the first joint's axis."""

    model: FingerOption = named("finger")
    servo: ServoConfig = ServoConfig()


class RoboticFingerPart(Part):
    """A finger whose servos follow their pulses and are limp without them. Contacts can stop it.

    Truth: `<name>_position` (n,) rad, `<name>_velocity` (n,) rad/s, `<name>_effort` (n,) N m at the shafts,
    `<name>_tip` (3,) m, `<name>_contact` (1,) N, the sum of the normal forces on it. The tip is in the frame of the
    hand that wears the finger, or of the world if it is mounted elsewhere.

    Attributes:
        joints: (n) names, from the base on.
        boards: the board that turns each servo, by joint, where there is one.
    """

    Config: ClassVar[type[PartConfig]] = RoboticFingerConfig
    summary = "a robotic extra finger with hobby servos, worn on a hand"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(RoboticFingerConfig, config)
        self.joints = config.model.names
        self.boards: dict[str, str] = {}
        self._bank = ServoBank(np.full(len(self.joints), config.servo.dead_band))
        self._powered = [True] * len(self.joints)  # which servos have their gains at present
        self._filled = nan  # s, the time to which effort and contact belong

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        name, n = self.name, len(self.joints)
        base = mjcf.body(parent, f"{name}/base", **self.at())
        add_finger(mjcf, base, name, self._config.model, self._config.servo)
        worn = self.carrier if self.carrier and mjcf.carried[self.carrier][0] is parent else None
        self._worn = parent.get("name") if worn else None
        tip = Signal(name=f"{name}_tip", shape=(3,), unit="m", frame=worn, labels=POINT, visual="points")
        self.truth = (
            Signal(name=f"{name}_position", shape=(n,), unit="rad", labels=self.joints),
            Signal(name=f"{name}_velocity", shape=(n,), unit="rad/s", labels=self.joints),
            Signal(name=f"{name}_effort", shape=(n,), unit="N m", labels=self.joints),
            tip,
            Signal(name=f"{name}_contact", shape=(1,), unit="N"),
        )

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        name, n = self.name, len(self.joints)
        first = model.joint(f"{name}/{self.joints[0]}")
        drive, q, v = int(model.actuator(first.name).id), int(first.qposadr[0]), int(first.dofadr[0])
        # Views of MuJoCo's own arrays; a finger's joints and servos lie side by side.
        servos = slice(drive, drive + n)
        self._qpos, self._qvel = data.qpos[q : q + n], data.qvel[v : v + n]
        self._ctrl, self._force = data.ctrl[servos], data.actuator_force[servos]
        self._gain, self._bias = model.actuator_gainprm[servos, 0], model.actuator_biasprm[servos]
        self._gains = self._gain.copy(), self._bias.copy()
        self._drag = model.dof_damping[v : v + n].copy()
        self._site = data.site_xpos[int(model.site(f"{name}/tip").id)]
        carrier = 0 if self._worn is None else int(model.body(self._worn).id)
        self._origin, self._axes = data.xpos[carrier], data.xmat[carrier].reshape(3, 3)
        bodies = [model.body(f"{name}/{joint}").id for joint in self.joints]
        self._touches = np.isin(model.geom_bodyid, bodies)
        self._effort, self._contact = np.zeros(n), 0.0
        self._follow()

    def latch(self, step: int) -> int | None:
        """Applies the pulses that have arrived; returns the step at which the next one does."""
        if self._bank.latch(step):
            self._follow()
        return self._bank.next_step()

    def fill(self, truth: Mapping[str, Array]) -> None:
        data, name = self._data, self.name
        if data.time != self._filled:  # forces of the last step; they can't be recomputed after `restore`
            self._filled = data.time
            self._effort[:] = self._force - self._drag * self._qvel
            self._contact = self._contact_force() if data.ncon else 0.0
        truth[f"{name}_position"][:] = self._qpos
        truth[f"{name}_velocity"][:] = self._qvel
        truth[f"{name}_effort"][:] = self._effort
        truth[f"{name}_tip"][:] = (self._site - self._origin).dot(self._axes)
        truth[f"{name}_contact"][0] = self._contact

    def save(self) -> Array:
        return np.concatenate([[self._filled, self._contact], self._effort, self._bank.save()])

    def restore(self, state: Array) -> None:
        n = len(self.joints)
        self._filled, self._contact = state[:2].tolist()
        self._effort[:] = state[2 : 2 + n]
        self._bank.restore(state[2 + n :])
        self._follow()

    # -- the servos

    def set_servos(self, targets: Mapping[str, float | None], at: int = 0) -> None:
        """Sets the targets that the servos' pulses encode from `at` on.

        Args:
            targets: target angles, rad, by joint. None ends the servo's pulses, which leaves it limp.
            at: world time, ns; a time in the past means from now on.
        """
        timestep = self._model.opt.timestep
        step = max(-(-at // round(timestep * 1e9)), round(self._data.time / timestep))
        for joint, target in targets.items():
            self._bank.command(self.joints.index(joint), nan if target is None else target, step)

    def place_servos(self, angles: Mapping[str, float]) -> None:
        """Places joints at angles (rad): where the user has put the finger before the run.

        Has an effect only before the first step.
        """
        if self._data.time == 0.0:
            for joint, angle in angles.items():
                self._qpos[self.joints.index(joint)] = angle
            mujoco.mj_kinematics(self._model, self._data)

    def joint_angles(self) -> Array:
        """(n,) rad: where the joints are."""
        return self._qpos.copy()

    def servo_targets(self) -> Array:
        """(n,) rad: the target that each servo holds at present; NaN for a servo without pulses."""
        return self._bank.held.copy()

    def _follow(self) -> None:
        """Sets the servos' targets and sets the gains of servos without pulses to 0."""
        held = self._bank.held.tolist()
        self._ctrl[:] = [0.0 if isnan(target) else target for target in held]
        if (powered := [not isnan(target) for target in held]) != self._powered:
            self._powered = powered
            gain, bias = self._gains
            self._gain[:] = gain * powered
            self._bias[:] = bias * np.array(powered)[:, None]

    def _contact_force(self) -> float:
        """The sum of the normal forces of all contacts, N."""
        total, force = 0.0, np.empty(6)
        for number in np.flatnonzero(self._touches[self._data.contact.geom].any(axis=1)).tolist():
            mujoco.mj_contactForce(self._model, self._data, number, force)
            total += float(force[0])
        return total
