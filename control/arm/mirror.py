"""`mirror`: an arm does what another one does, as in a mirror between the two."""

from __future__ import annotations

from typing import Any, ClassVar, Final, Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.arm.options import each, joints
from srl.control.shared.ramp import Ramps, factor
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError, WiringError
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.rotation import Vector
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.transforms import Transform, device
from srl.runtime.models.robot_model import RobotOption
from srl.runtime.models.robots import RobotDescription

_BEGINNING: Final = 0.5  # s, in which it takes up its speed
_ENDING: Final = 0.2  # s, in which it comes to rest from its greatest speed where the other arm is lost
_TURNED: Final = 0.02  # rad, by which an axis may be off the mirrored one
_ASIDE: Final = 0.01  # m


class MirrorConfig(ControllerConfig):
    """Options of `mirror`."""

    renamed: ClassVar[dict[str, str]] = {"patience": "timeout"}

    robot: RobotOption = Field(description="the arm that is led")
    other: RobotOption = Field(description="the arm that leads")
    joints: dict[str, str] = Field(
        default_factory=dict, description="the leading joint, by joint of the led arm; left out: that of the same name"
    )
    normal: Vector | None = Field(
        None, description="of the mirror, in the led arm's base frame; null: from one base to the other"
    )
    speed: dict[str, Positive] | Positive = Field(0.5, description="rad/s, by joint of the led arm, the most")
    timeout: float = Field(0.5, gt=0, le=10, description="s without the other arm after which the limb stops")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        leading = self.leading
        for key, given, known in (("joints", self.joints, self.robot), ("joints", leading.values(), self.other)):
            for name in given:
                if name not in known.labels:
                    problem = f"{key}: {known.name} has no joint '{name}'"
                    raise OptionError(problem, f"It has {', '.join(known.labels)}")
        if len(set(leading.values())) < len(leading) or self.robot.n != self.other.n:
            raise OptionError("joints: each joint of one arm needs one of the other's", "Name each once")
        each(self.speed, self.robot, "speed")
        if self.normal is not None and float(np.linalg.norm(self.normal)) < 1e-6:
            raise ValueError("normal: it has no direction")
        return self

    @property
    def leading(self) -> dict[str, str]:
        """The leading joint, by joint of the led arm, in its order."""
        return {name: self.joints.get(name, name) for name in self.robot.labels}


class Mirror(Controller):
    """q_i = sign_i q_j of the other arm, at most at `speed`: the tool is at the other one's mirror image.

    Inputs: `q` (n,) rad, measured, of the led arm; `other` (n,) rad, of the other one. Outputs: `q` (n,) rad and
    `q_velocity` (n,) rad/s, of the led arm. Where a joint slides, m and m/s.

    The mirror is the plane through the middle between the two bases, whose places the tree of frames says. A turn about
    an axis is mirrored to one about the mirrored axis by the opposite angle, and a way along it to the same way. So the
    signs follow from the two descriptions; arms that aren't each other's mirror images at zero are refused.

    It starts where the limb is. While the other arm isn't there, the limb comes to rest within 0.2 s and stands, and
    after `timeout` it stops. When it is back, the limb takes up its speed again.
    """

    Config = MirrorConfig
    summary = "an arm does what another one does, mirrored by a plane, joint by joint"

    def __init__(self, name: str, config: MirrorConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
        self.inputs = (joints(robot, "q", "rad"), joints(config.other, "other", "rad"))
        self.outputs = (joints(robot, "q", "rad"), joints(robot, "q_velocity", "rad/s"))
        self._ramps = Ramps(factor("speed", 0.0, 1.0, "of all speeds; 0 stands"))
        self.parameters = self._ramps.parameters
        self.transforms = (Transform("other", device("other"), device("q"), "the other arm's base in this one's"),)
        self._config = config
        self._speed = each(config.speed, robot, "speed")
        self._from = np.array([config.other.labels.index(leading) for leading in config.leading.values()])
        self._signs = np.ones(robot.n)
        self._q = np.zeros(robot.n)
        self._v = np.zeros(robot.n)
        self._missing = self._started = 0.0

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        config = self._config
        placed = rotation.homogeneous(self.transform["other"])
        between = placed[:3, 3]
        normal = np.array(between if config.normal is None else config.normal, dtype=float)
        length = float(np.linalg.norm(normal))
        place = f"controllers.{self.name}"
        if length < 1e-6:
            raise WiringError(place, "both arms stand at the same place, so no plane is between them",
                              "Say in `frames:` where they stand, or give `normal`")  # fmt: skip
        normal /= length
        reflect = np.eye(3) - 2.0 * np.outer(normal, normal)
        middle = between / 2.0
        if (np.diff(self._from) < 0).any():  # images at zero, but not elsewhere: turns in another order end elsewhere
            order = ", ".join(map(config.other.labels.__getitem__, self._from))
            problem = f"from the base on, the leading joints come as {order}; {config.other.name} has another order"
            raise WiringError(place, problem, f"It has {', '.join(config.other.labels)}: correct `joints`")
        own, theirs = _axes(config.robot, np.eye(4)), _axes(config.other, placed)
        for i, (name, leading) in enumerate(config.leading.items()):
            axis, point = own[i]
            other_axis, other_point = theirs[self._from[i]]
            mirrored = reflect @ other_axis
            off = middle + reflect @ (other_point - middle) - point
            aside = float(np.linalg.norm(off - axis * (off @ axis)))
            same = float(axis @ mirrored)
            slides = config.robot.joints[i].slides
            if slides != config.other.joints[self._from[i]].slides:
                raise WiringError(place, f"one of {name} and {leading} slides, and the other turns", "Correct `joints`")
            if abs(same) < np.cos(_TURNED) or (aside > _ASIDE and not slides):
                problem = (
                    f"at zero the axis of {name} isn't the mirror image of {leading}'s: "
                    f"{np.degrees(np.arccos(min(abs(same), 1.0))):.3g} degrees and {aside:.3g} m beside it"
                )
                raise WiringError(place, problem, "Correct `frames:`, `joints` or `normal`")
            self._signs[i] = np.sign(same) * (1.0 if slides else -1.0)

    def reset(self) -> None:
        self._ramps.reset(self.param)
        self._q[:] = self.applied.get("q", self.input["q"])
        self._v[:] = 0.0
        self._missing, self._started, self.lost = 0.0, 0.0, False
        self.output["q"][:], self.output["q_velocity"][:] = self._q, 0.0

    def update(self, dt: float) -> None:
        self._ramps.update(self.param, dt)
        applied = self.applied.get("q")
        if applied is not None and np.isfinite(applied).all():
            self._q[:] = applied  # what the guard holds back isn't wound up
        elif not np.isfinite(self._q).all():
            self._q[:] = self.input["q"]  # nobody knew at the reset where the limb was
        other, robot = self.input["other"], self._config.robot
        seen = bool(np.isfinite(other).all())
        self._missing = 0.0 if seen else self._missing + dt
        self.lost = self._missing > self._config.timeout
        share = self._ramps.values["speed"]
        if seen:
            aim = np.clip(self._signs * other[self._from], robot.q_lower, robot.q_upper)
            self._started = min(1.0, self._started + dt / _BEGINNING)
            most = self._started * share * self._speed * dt
            step = np.clip(aim - self._q, -most, most)
        else:
            less = self._speed * dt / _ENDING
            slower = self._v - np.clip(self._v, -less, less)
            # At the end of a joint's travel it stops at once.
            step = np.clip(self._q + slower * dt, robot.q_lower, robot.q_upper) - self._q
            step = np.clip(step, -np.abs(slower) * dt, np.abs(slower) * dt)
            self._started = min(self._started, float(np.max(np.abs(slower) / self._speed)))
        self._v[:] = step / dt if dt > 0.0 else 0.0
        self._q += step
        self.output["q"][:], self.output["q_velocity"][:] = self._q, self._v


def _axes(robot: RobotDescription, place: Array) -> list[tuple[Array, Array]]:
    """Direction and a point of each joint's axis at zero, for a base at `place` (4, 4)."""
    found = []
    for joint in robot.joints:
        place = place @ joint.moved(0.0)
        found.append((place[:3, 2], place[:3, 3]))
    return found
