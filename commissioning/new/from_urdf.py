"""A profile for a limb from its URDF: a bus of motors that are chosen by its weight, slow limits, a simulated chain."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pinocchio as pin
from pydantic import ValidationError

from srl.commissioning.new.limb_drivers import limb_drivers
from srl.runtime import __version__
from srl.runtime.contracts.errors import OptionError, RequestError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.limb_drives import LimbDrives, LimbJoint
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.validation import CORRECT, refusal
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots import RobotDescription
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.runtime.profile.edit import as_yaml

_POSTURES: Final = 200
ROOM: Final = 2.0  # a motor's stall torque over what the limb's weight asks of it
_SPEED: Final = 0.5  # rad/s
_DOWNHILL, _STEPS = 0.1, 2000  # rad a step where gravity pulls most
_NOTHING: Final = 1e-6  # N m, from which on a joint's weight pulls it
_OFF_STOPS: Final = 0.02  # rad or m
_SLIDE: Final = 0.2  # of the same number, in m/s


class Limb:
    """A limb and its motors.

    Attributes:
        robot: its description.
        drives: its driver.
        home: (n,) rad or m, where it begins: where it comes to rest by itself, if its drives are loose before a run.
        joints: as its motors feel them.
        motors: by joint, the weakest that has ROOM, else the strongest.
    """

    def __init__(
        self, file: Path, base: str | None, tip: str | None, drives: LimbDrives, answers: Mapping[str, Any]
    ) -> None:
        """Reads the URDF. `answers`: to what `drives` asks. Raises RequestError: nothing can be made of it."""
        self.file, self.ends, self.drives, self.answers = file, {"base": base, "tip": tip}, drives, answers
        self.robot = robot = _read(file, base, tip)
        if robot.slides and not drives.slides:
            able = ", ".join(name for name, kind in limb_drivers().items() if kind.slides)
            problem = f"'{robot.slides[0]}' slides, and it moves joints that turn"
            raise RequestError(f"--driver {drives.driver}", problem, f"Choose {able}, or another --base or --tip")
        torque, inertia = weight(robot), _inertia(robot)
        speed = np.minimum([_SPEED * (_SLIDE if joint.slides else 1.0) for joint in robot.joints], robot.dq_max)
        self.home = hanging(robot) if drives.parked else robot.home
        rows = zip(robot.joints, robot.q_lower, robot.q_upper, self.home, speed, torque, inertia, strict=True)
        self.joints = [LimbJoint(joint.name, joint.slides, *map(float, numbers)) for joint, *numbers in rows]
        known = drives.motors(answers)
        self.motors = [
            next((m for m in known if m.stall_torque >= ROOM * self._asked(j)), known[-1]) for j in self.joints
        ]

    def _asked(self, joint: LimbJoint) -> float:
        """N m at the shaft, that the weight asks."""
        return joint.torque * self.drives.lead(joint)

    def strained(self) -> list[str]:
        """What a person should know of joints that can't do what is asked of them."""
        found = []
        for joint, motor in zip(self.joints, self.motors, strict=True):
            if ROOM * self._asked(joint) > motor.stall_torque:
                found.append(
                    f"{joint.name}: the limb's weight asks up to {self._asked(joint):.3g} N m, and {motor.name} has "
                    f"{motor.stall_torque:.3g} N m at a stall: too little room"
                )
            elif words := self.drives.strained(joint, motor):
                found.append(words)
            lower, upper = self.drives.travel(joint)
            if lower > joint.lower or upper < joint.upper:
                unit = "m" if joint.slides else "rad"
                found.append(f"{joint.name}: its travel is {lower:.3g} to {upper:.3g} {unit}, less than the URDF's, as "
                             "the wire or the encoder tells no more")  # fmt: skip
        return found

    def profile(self, name: str, folder: Path) -> str:
        """The text of a profile of this name in a folder."""
        return _text(name, self, _seen_from(folder, self.file))


def _seen_from(folder: Path, file: Path) -> str:
    return os.path.relpath(file.absolute(), folder.absolute())


def weight(robot: RobotDescription) -> Array:
    """(n,) N m: the most that its weight asks of each joint, for random postures and tilts of the base."""
    model = pinocchio_model(robot)
    data, rng = model.createData(), np.random.default_rng(0)
    most = np.zeros(robot.n)
    for _ in range(_POSTURES):
        down = rng.normal(size=3)
        model.gravity.linear = GRAVITY * down / np.linalg.norm(down)
        most = np.maximum(most, np.abs(pin.computeGeneralizedGravity(model, data, _posture(robot, rng))))
    return most


def hanging(robot: RobotDescription) -> Array:
    """(n,) rad or m: where the limb hangs by itself, with its base upright. It is between the limits by a little.

    Each step goes down the slope of the potential energy.
    """
    model = pinocchio_model(robot)
    data, scale = model.createData(), weight(robot)
    room = np.minimum(_OFF_STOPS, 0.1 * (robot.q_upper - robot.q_lower))
    step = (
        np.where([joint.slides for joint in robot.joints], _SLIDE, 1.0)
        * _DOWNHILL
        / np.where(scale > _NOTHING, scale, np.inf)
    )
    q = robot.home + _DOWNHILL * step * scale  # not at the top, where nothing pulls it either way
    for _ in range(_STEPS):
        q -= step * pin.computeGeneralizedGravity(model, data, q)
        q = np.clip(q, robot.q_lower + room, robot.q_upper - room)
    return np.round(q, 3) + 0.0


def _inertia(robot: RobotDescription) -> Array:
    """(n,) kg m^2: the most that each joint moves alone, in random postures."""
    model = pinocchio_model(robot)
    data, rng = model.createData(), np.random.default_rng(0)
    most = np.zeros(robot.n)
    for _ in range(_POSTURES):
        most = np.maximum(most, np.diag(pin.crba(model, data, _posture(robot, rng))))
    return most


def _posture(robot: RobotDescription, rng: np.random.Generator) -> Array:
    return rng.uniform(np.maximum(robot.q_lower, -np.pi), np.minimum(robot.q_upper, np.pi))


def _text(title: str, limb: Limb, file: str) -> str:
    robot, drives, joints = limb.robot, limb.drives, limb.joints
    ends = "".join(f", {key}: {json.dumps(value)}" for key, value in limb.ends.items() if value)
    parked = ""
    if drives.parked:
        homes, parked = {joint.name: joint.home for joint in joints}, "   # where it hangs by itself"
        ends += f",\n    home: {as_yaml(homes)}"
    motors, axes = [], []
    for i, (joint, motor) in enumerate(zip(joints, limb.motors, strict=True)):
        comment = f"   # its weight asks up to {joint.torque:.3g} {'N' if joint.slides else 'N m'}"
        entry = drives.entry(joint, motor, i + 1, limb.answers)
        motors.append(f"      {as_yaml(joint.name)}: {as_yaml(entry)}{comment}")
        axis = {"model": motor.name, **drives.geared(joint)}
        axes.append(f"        {as_yaml(joint.name)}: {as_yaml(axis)}")
    speeds = as_yaml({joint.name: _round(joint.speed) for joint in joints})
    accelerations = as_yaml({joint.name: _round(4 * joint.speed) for joint in joints})
    joined = as_yaml([joint.name for joint in joints])
    options = "".join(f"    {key}: {as_yaml(value)}\n" for key, value in drives.device(joints, limb.answers).items())
    chain = "".join(f"      {key}: {as_yaml(value)}\n" for key, value in drives.chain(limb.motors).items())
    return f"""\
# Made of {os.path.basename(file)} by srl {__version__}: a limb whose joints a client of the bus sets.
name: {title}
summary: {as_yaml(f"a limb from {os.path.basename(file)}, jogged")}
rate: 100
models:
  limb: {{kind: robot, urdf: {json.dumps(file, ensure_ascii=False)}{ends}}}{parked}
devices:
  arm:
    driver: {drives.driver}
    port: {drives.port}
    robot: limb                 # its picture
{options}    {drives.entries + ":":<28}# ids, directions (`reversed`) and zeros are yours to find out: srl jog
{_lines(motors)}
setpoints:
  client.position: {{shape: [{robot.n}], unit: {_unit(robot)}, labels: {joined}}}
controllers:
  - use: joint-setpoint
    name: set
    joints: {joined}
    unit: {_unit(robot)}
    in: {{target: client.position}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
guard:
  arm.position_command:         # slow, until you know the limb; not faster than the URDF says
    velocity: {speeds}
    acceleration: {accelerations}
stop: {{arm: hold}}
faults: {{bus-loss: hold}}
sim:
  world: cell
  parts:
    arm:
      part: {drives.part}
      robot: limb               # links, limits and masses are the URDF's
{chain}      axes:
{_lines(axes)}
"""


def _read(file: Path, base: str | None, tip: str | None) -> RobotDescription:
    place = f"--urdf {file}"
    try:
        kept = KeptFile.read(file.absolute(), "Name an existing URDF")
        entry: dict[str, Any] = {"urdf": kept, "base": base, "tip": tip}
        return RobotModel.model_validate(entry).robot.with_masses()
    except OptionError as error:
        raise RequestError(place, error.problem, error.remedy) from None
    except ValidationError as error:
        first = refusal(error, entry)
        remedy = (first.remedy or CORRECT).replace("'tip'", "--tip").replace("'base'", "--base")
        raise RequestError(place, first.problem, remedy) from None


def _unit(robot: RobotDescription) -> str:
    return "m" if len(robot.slides) == robot.n else "rad"


def _round(value: float) -> float:
    return float(f"{value:.6g}")


def _lines(lines: list[str]) -> str:
    return "\n".join(lines)
