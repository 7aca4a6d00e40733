"""A profile for a limb from its URDF: a bus of servos that are chosen by its weight, slow limits, a simulated chain."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Final, Protocol, get_args

import numpy as np
import pinocchio as pin
from pydantic import ValidationError

from runtime import __version__
from runtime.contracts import registry
from runtime.contracts.errors import OptionError, RequestError
from runtime.contracts.files import KeptFile
from runtime.contracts.gravity import GRAVITY
from runtime.contracts.signals import Array
from runtime.control.robot_model import RobotModel
from runtime.control.robots import RobotDescription
from runtime.control.robots.pinocchio_model import pinocchio_model

_PORTS: Final = {"dynamixel": "/dev/ttyUSB0", "feetech": "/dev/ttyACM0"}
_POSTURES: Final = 200
ROOM: Final = 2.0  # a servo's stall torque over what the limb's weight asks of it
_SPEED: Final = 0.5  # rad/s
_SLIDE: Final = 0.2  # of the same number, in m/s
_LEAD: Final = 0.01  # m/rad


class Servo(Protocol):
    """What is needed of a servo's data sheet: its name, and N m at a stall."""

    @property
    def name(self) -> str: ...

    @property
    def stall_torque(self) -> float: ...


class Limb:
    """A limb and its servos.

    Attributes:
        robot: its description.
        torque: (n,) N m, the most that its weight asks of each joint.
        servos: by joint, the weakest that has ROOM, else the strongest.
    """

    def __init__(self, file: Path, base: str | None, tip: str | None, driver: str) -> None:
        """Reads the URDF. `driver`: of a bus of servos. Raises RequestError: nothing can be made of it."""
        self.file, self.ends, self.driver = file, {"base": base, "tip": tip}, driver
        self.robot = _read(file, base, tip)
        self.torque = weight(self.robot)
        known = sorted(_servos(driver), key=lambda servo: servo.stall_torque)
        self.servos: dict[str, Servo] = {
            joint: next((servo for servo in known if servo.stall_torque >= ROOM * value), known[-1])
            for joint, value in zip(self.robot.labels, self.torque.tolist(), strict=True)
        }

    def strained(self) -> list[str]:
        """What a person should know of joints whose servo has too little room."""
        return [
            f"{joint}: the limb's weight asks up to {value:.3g} N m, and {servo.name} has {servo.stall_torque:.3g} N m "
            "at a stall: too little room"
            for (joint, servo), value in zip(self.servos.items(), self.torque.tolist(), strict=True)
            if ROOM * value > servo.stall_torque
        ]

    def profile(self, name: str, folder: Path) -> str:
        """The text of a profile of this name in a folder."""
        inside = os.path.relpath(self.file.absolute(), folder.absolute())
        return _text(name, self, inside)


def _servos(driver: str) -> list[Servo]:
    """The servos that a driver's options know."""
    config = registry.load("drivers", driver, f"--driver {driver}").Config
    motor: Any = get_args(config.model_fields["motors"].annotation)[1]
    return [motor(id=1, model=name).facts for name in get_args(motor.model_fields["model"].annotation)]


def weight(robot: RobotDescription) -> Array:
    """(n,) N m: the most that its weight asks of each joint, for random postures and tilts of the base."""
    model = pinocchio_model(robot)
    data, rng = model.createData(), np.random.default_rng(0)
    lower, upper = np.maximum(robot.q_lower, -np.pi), np.minimum(robot.q_upper, np.pi)
    most = np.zeros(robot.n)
    for _ in range(_POSTURES):
        down = rng.normal(size=3)
        model.gravity.linear = GRAVITY * down / np.linalg.norm(down)
        most = np.maximum(most, np.abs(pin.computeGeneralizedGravity(model, data, rng.uniform(lower, upper))))
    return most


def _text(title: str, limb: Limb, file: str) -> str:
    robot, servos, torque = limb.robot, limb.servos, limb.torque
    driver, names = limb.driver, list(robot.labels)
    ends = "".join(f", {key}: {json.dumps(value)}" for key, value in limb.ends.items() if value)
    far = np.abs([robot.q_lower, robot.q_upper]).max() > np.pi - 0.05 or bool(robot.slides)
    motors, axes, speeds, accelerations = [], [], [], []
    for i, name in enumerate(names):
        slides, model = name in robot.slides, servos[name].name
        lead = f", m_per_rad: {_LEAD}" if slides else ""
        bounds = [(key, getattr(robot, f"q_{key}").item(i)) for key in ("lower", "upper")]
        limits = "".join(f", {key}: {value:.6g}" for key, value in bounds if np.isfinite(value))
        comment = f"   # its weight asks up to {torque.item(i):.3g} {'N' if slides else 'N m'}"
        motors.append(f"      {_key(name)}: {{id: {i + 1}, model: {model}{lead}{limits}}}{comment}")
        axes.append(f"        {_key(name)}: {{model: {model}{lead}}}")
        speed = min(_SPEED * (_SLIDE if slides else 1.0), robot.dq_max.item(i))
        speeds.append(f"{_key(name)}: {speed:g}")
        accelerations.append(f"{_key(name)}: {4 * speed:g}")
    joined = ", ".join(map(_key, names))
    mode = "    mode: extended\n" if far else ""
    return f"""\
# Made of {os.path.basename(file)} by srl {__version__}: a limb whose joints a client of the bus sets.
name: {title}
summary: a limb from {os.path.basename(file)}, jogged
rate: 100
models:
  limb: {{kind: robot, urdf: {json.dumps(file)}{ends}}}
devices:
  arm:
    driver: {driver}
    port: {_PORTS[driver]}
    robot: limb                 # its picture
{mode}    motors:                     # ids, directions (`reversed`) and zeros are yours to find out: srl jog
{_lines(motors)}
setpoints:
  client.position: {{shape: [{robot.n}], unit: {_unit(robot)}, labels: [{joined}]}}
controllers:
  - use: joint-setpoint
    name: set
    joints: [{joined}]
    unit: {_unit(robot)}
    in: {{target: client.position}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
guard:
  arm.position_command:         # slow, until you know the limb; not faster than the URDF says
    velocity: {{{", ".join(speeds)}}}
    acceleration: {{{", ".join(accelerations)}}}
stop: {{arm: hold}}
faults: {{bus-loss: hold}}
sim:
  world: cell
  parts:
    arm:
      part: {driver}-chain
      robot: limb               # links, limits and masses are the URDF's
      axes:
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
        cause = error.errors()[0].get("ctx", {}).get("error")
        if not isinstance(cause, OptionError):
            raise
        remedy = cause.remedy.replace("'tip'", "--tip").replace("'base'", "--base")
        raise RequestError(place, cause.problem, remedy) from None


def _unit(robot: RobotDescription) -> str:
    return "m" if len(robot.slides) == robot.n else "rad"


def _key(name: str) -> str:
    """The name as a YAML key."""
    plain = name.replace("_", "").replace("-", "").isalnum() and not name[0].isdigit() and name[0] != "-"
    return name if plain and name.lower() not in ("y", "n", "yes", "no", "on", "off", "true", "false", "null") \
        else json.dumps(name)  # fmt: skip


def _lines(lines: list[str]) -> str:
    return "\n".join(lines)
