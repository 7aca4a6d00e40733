"""Pisa/IIT SoftHand: one motor pulls one tendon through all joints, springs open them (sheet softhand).

Each flexion joint is a rolling pair of two equal hinges. The tendon only pulls, so a finger that touches an object
stops while the others continue to close.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan, nan, pi, radians
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from pydantic import Field

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.models.robots.softhand import (
    FACTOR,
    FINGERS,
    FLEXION,
    FULL,
    KNUCKLE,
    KNUCKLES,
    PAIRS,
    PALM,
    PHALANX,
    RADIUS,
    ROLL,
    TIP,
    thumb,
)
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig
from srl.sim.world.robot_mjcf import ROBOT_CONTACT

CLOSED: Final = 19000 / 65536 * 2 * pi  # rad of the motor at which the empty hand is closed
_BASE_MASS: Final = 0.112  # kg, of base and motor: the total mass without palm and fingers
_PALM_MASS: Final = 0.228  # kg
_LIGAMENT: Final = 0.02  # N m/rad per joint
# Pulleys and springs are larger near the palm. The free hand still closes evenly, but a finger around an object
# presses with all its phalanges instead of rolling off it. Our own choice.
_STRENGTH: Final = {"abduction": 2.0, "inner": 1.5, "middle": 1.0, "outer": 0.5}
_LIMP: Final = 0.3  # N m s/rad, drag of motor and gear without power
_KNUCKLE_MASS, _ROLL_MASS, _PHALANX_MASS, _TIP_MASS = 0.009, 0.001, 0.004, 0.009  # kg


class SoftHandConfig(PartConfig):
    """Options of the hand. The motor's values are our assumptions; they fit closing time, grasp force and weight."""

    current_limit: float = Field(default=1.5, gt=0, description="A")
    torque_constant: float = Field(default=3.0, gt=0, description="N m/A at the gear's output")
    speed: float = Field(default=1.8, gt=0, description="rad/s of the output without load")
    stiffness: float = Field(default=40.0, gt=0, description="N m/rad of the position loop, up to the current limit")
    friction: float = Field(default=0.15, ge=0, description="N m, dry, of motor and gear at the output")
    grip: float = Field(default=1.0, gt=0, description="friction of the fingers' rubber")


class SoftHandPart(Part):
    """A right hand. Base frame: z along the fingers, y to the thumb's side, x out of the palm.

    Bodies: `<name>/base`, `<name>/palm`. The motor's `position` is 0 when open and 1.82 rad (19000 of 65536 counts per
    turn) when closed. Parts of the hand don't touch each other.
    """

    Config: ClassVar[type[PartConfig]] = SoftHandConfig
    summary = "Pisa/IIT SoftHand, 19 joints, one motor"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = cast(SoftHandConfig, config)
        self.labels = tuple(f"{finger}_{joint}" for finger in FINGERS for joint in ("abduction", *PAIRS[finger]))
        self.truth = (
            Signal(name=f"{name}_motor", shape=(1,), unit="rad"),
            Signal(name=f"{name}_current", shape=(1,), unit="A"),
            Signal(name=f"{name}_joints", shape=(19,), unit="rad", labels=self.labels),
            Signal(name=f"{name}_contact_force", shape=(5,), unit="N", labels=FINGERS),
        )
        self._goal = nan
        self._powered: bool | None = None  # whether the drive is set for power; None: it isn't set yet
        self._restored = (-1.0, 0.0)  # s and A: a restored world's current can't be recomputed

    # -- construction

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        base = mjcf.body(parent, f"{name}/base", **self.at())
        add(base, "inertial", pos=(0, 0, 0.03), mass=_BASE_MASS, diaginertia=(1e-4, 1e-4, 1e-4))
        place, size = PALM
        palm = mjcf.body(base, f"{name}/palm", pos=place)
        half = tuple(v / 2 for v in size)
        box = {"type": "box", "pos": (0, 0, half[2]), "size": half}
        rubber = {"friction": (config.grip, 0.005, 0.0001), "condim": 4, "rgba": "0.25 0.25 0.28 1", **ROBOT_CONTACT}
        add(palm, "geom", name=f"{name}/palm", mass=_PALM_MASS, **box, **rubber)
        pulls: list[tuple[str, float, float]] = []
        for finger, (knuckle, swing) in KNUCKLES.items():
            self._add_finger(palm, finger, knuckle, swing, rubber, pulls)
        # Lever arms in motor angle: the free hand is just closed when the motor is, if all springs are alike.
        lever = CLOSED / (FULL * sum(factor**2 * strength for _, factor, strength in pulls))
        stall = config.torque_constant * config.current_limit
        motor = add(base, "body", name=f"{name}/motor")
        add(motor, "inertial", pos=(0, 0, 0), mass=1e-6, diaginertia=(1e-9, 1e-9, 1e-9))
        add(
            motor,
            "joint",
            name=f"{name}/motor",
            axis=(0, 1, 0),
            armature=0.01,
            damping=stall / config.speed,
            frictionloss=config.friction,
            range=(-0.2, 1.5 * CLOSED),
        )
        add(
            mjcf.actuator,
            "general",
            name=f"{name}/motor",
            joint=f"{name}/motor",
            gainprm=config.stiffness,
            biastype="affine",
            biasprm=(0.0, -config.stiffness, 0.0),
            forcerange=(-stall, stall),
        )
        tendon = add(mjcf.tendon, "fixed", name=f"{name}/tendon", range=(-2 * CLOSED, 0.0), solreflimit=(0.005, 1.0))
        add(tendon, "joint", joint=f"{name}/motor", coef=1.0)
        for joint, factor, strength in pulls:
            add(tendon, "joint", joint=joint, coef=-lever * factor * strength)

    def _add_finger(
        self,
        palm: Element,
        finger: str,
        knuckle: tuple[float, float, float],
        swing: float,
        rubber: dict[str, Any],
        pulls: list[tuple[str, float, float]],
    ) -> None:
        """Adds a finger's bodies; appends its hinges and their share of the synergy to `pulls`."""
        called = f"{self.name}/{finger}"
        if finger == "thumb":
            y, z = thumb()
            body = add(palm, "body", name=f"{called}_abduction", pos=knuckle, xyaxes=(1, 0, 0, 0, z, -y))
            axis, limits = (0.0, y, -z), (0.0, radians(90))  # swings about the palm's -z, outward in front of the palm
        else:
            body = add(palm, "body", name=f"{called}_abduction", pos=knuckle)
            axis, limits = (-1.0, 0.0, 0.0), (-radians(30), radians(30))
        self._hinge(body, f"{called}_abduction", axis, limits, _STRENGTH["abduction"])
        if swing:
            pulls.append((f"{called}_abduction", swing, _STRENGTH["abduction"]))
        add(body, "inertial", pos=(0, 0, 0), mass=_KNUCKLE_MASS, diaginertia=(1e-6, 1e-6, 1e-6))
        at = KNUCKLE
        for pair in PAIRS[finger]:
            factor, last = FACTOR.get((finger, pair), 1.0), pair == "outer"
            for half in ("1", "2"):
                joint = f"{called}_{pair}_{half}"
                body = add(body, "body", name=joint, pos=(0, 0, at))
                self._hinge(body, joint, FLEXION, (0.0, FULL), _STRENGTH[pair])
                pulls.append((joint, factor, _STRENGTH[pair]))
                at = ROLL
                if half == "1":
                    add(body, "inertial", pos=(0, 0, ROLL / 2), mass=_ROLL_MASS, diaginertia=(1e-7, 1e-7, 1e-7))
            length = TIP if last else PHALANX
            add(
                body,
                "geom",
                name=joint,
                type="capsule",
                fromto=(0, 0, 0, 0, 0, length),
                size=RADIUS,
                mass=_TIP_MASS if last else _PHALANX_MASS,
                **rubber,
            )
            at = PHALANX

    def _hinge(
        self, body: Element, name: str, axis: tuple[float, ...], limits: tuple[float, float], strength: float
    ) -> None:
        # A flexion joint's two hinges turn by equal, half angles, so each is twice as stiff. A swing is the same.
        spring = {"stiffness": 2 * _LIGAMENT * strength, "damping": 0.001, "armature": 2e-5}
        add(body, "joint", name=name, axis=axis, range=limits, **spring)

    # -- life cycle

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        motor, drive = model.joint(f"{self.name}/motor"), model.actuator(f"{self.name}/motor").id
        qpos, dof = int(motor.qposadr[0]), int(motor.dofadr[0])
        self._angle, self._speed = data.qpos[qpos : qpos + 1], data.qvel[dof : dof + 1]
        self._force, self._ctrl = data.actuator_force[drive : drive + 1], data.ctrl[drive : drive + 1]
        self._gain, self._bias = model.actuator_gainprm[drive], model.actuator_biasprm[drive]
        self._range, self._damping = model.actuator_forcerange[drive], model.dof_damping[dof : dof + 1]
        self._drag = float(self._damping[0])
        hinges = np.zeros((19, model.nq))
        for i, label in enumerate(self.labels):
            parts = (label,) if label.endswith("_abduction") else (f"{label}_1", f"{label}_2")
            for part in parts:
                hinges[i, int(model.joint(f"{self.name}/{part}").qposadr[0])] = 1.0
        self._first, self._last = (int(v) for v in np.flatnonzero(hinges.any(axis=0))[[0, -1]])
        self._hinges = hinges[:, self._first : self._last + 1]
        self._turned = data.qpos[self._first : self._last + 1]
        geoms = [model.geom(i).name for i in range(model.ngeom)]
        owner = {f"{self.name}/{finger}": i for i, finger in enumerate(FINGERS)}
        self._finger = np.array([owner.get(geom.split("_")[0] if "/" in geom else "", -1) for geom in geoms])
        self.current_limit = self._config.current_limit
        self.command_position(None)

    def command_position(self, position: float | None) -> None:
        """Sets the motor's target, rad (0 open, 1.82 closed), from the next physics step on; None: no power."""
        self._goal = nan if position is None else float(position)
        powered = position is not None
        self._ctrl[0] = self._goal if powered else 0.0
        if powered is not self._powered:
            self._powered = powered
            self._gain[0] = self._config.stiffness * powered
            self._bias[1] = -self._config.stiffness * powered
            self._damping[0] = self._drag if powered else _LIMP  # an open winding doesn't brake

    @property
    def commanded(self) -> float | None:
        """The motor's target, rad; None without power."""
        return None if isnan(self._goal) else self._goal

    @property
    def current_limit(self) -> float:
        """A, greatest current of the motor."""
        return float(self._range[1] / self._config.torque_constant)

    @current_limit.setter
    def current_limit(self, amperes: float) -> None:
        most = amperes * self._config.torque_constant
        self._range[:] = -most, most

    @property
    def position(self) -> float:
        """rad of the motor's output; 0 open, 1.82 closed."""
        return float(self._angle[0])

    @property
    def velocity(self) -> float:
        """rad/s of the motor's output."""
        return float(self._speed[0])

    @property
    def current(self) -> float:
        """A, positive when closing; from the last physics step."""
        when, current = self._restored
        if when == self._data.time:
            return current
        if isnan(self._goal):
            return 0.0
        return float((self._force[0] - self._drag * self._speed[0]) / self._config.torque_constant)

    def joints(self) -> Array:
        """(19,) rad, in the order of `labels`; a rolling pair counts as one joint of up to 90 degrees."""
        return cast(Array, self._hinges @ self._turned)

    def contact_force(self) -> Array:
        """(5,) N, sum of the normal forces on each finger, thumb first."""
        total, wrench, data = np.zeros(5), np.empty(6), self._data
        for number, pair in enumerate(self._finger[data.contact.geom].tolist() if data.ncon else ()):
            for finger in pair:
                if finger >= 0:
                    mujoco.mj_contactForce(self._model, data, number, wrench)
                    total[finger] += wrench[0]
        return total

    def fill(self, truth: Mapping[str, Array]) -> None:
        name = self.name
        truth[f"{name}_motor"][0] = self.position
        truth[f"{name}_current"][0] = self.current
        np.dot(self._hinges, self._turned, out=truth[f"{name}_joints"])
        truth[f"{name}_contact_force"][:] = self.contact_force() if self._data.ncon else 0.0

    def save(self) -> Array:
        return np.array([-1.0 if isnan(self._goal) else 1.0, self._ctrl[0], self._range[1], self.current])

    def restore(self, state: Array) -> None:
        powered, goal, limit, current = state.tolist()
        self._range[:] = -limit, limit
        self.command_position(goal if powered > 0 else None)
        self._restored = (float(self._data.time), current)
