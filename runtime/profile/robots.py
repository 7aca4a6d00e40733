"""Warnings and remarks about the arms that a profile has from URDFs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from pydantic.fields import FieldInfo

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.signals import Command, Kind
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots import ARMS, RobotDescription
from srl.runtime.profile.profile import Profile

_BOUNDS = (
    ("lower", "q_lower", -1.0),
    ("upper", "q_upper", 1.0),
    ("velocity", "dq_max", 1.0),
    ("effort", "tau_max", 1.0),
)
_ROOM = 1e-3  # share by which a bound may be beyond the URDF's: rounding


def remarks(profile: Profile) -> Iterator[tuple[str, str]]:
    """Key and text of what a person should know of each."""
    for name, model in profile.models.items():
        if isinstance(model, RobotModel):
            yield from ((f"models.{name}", text) for text in model.remarks())


def warnings(
    profile: Profile, devices: list[Driver], options: Iterable[tuple[str, FieldInfo, Any]]
) -> Iterator[tuple[str, str]]:
    """Key and text of the warnings about each. `options`: all of the profile's."""
    named = {name: model.robot for name, model in profile.models.items() if isinstance(model, RobotModel)}
    for name, robot in named.items():
        yield from ((f"models.{name}", text) for text in robot.warnings)
    robots = list(named.values())
    for path, _, value in options:
        if isinstance(value, RobotDescription) and all(value is not r for r in (*robots, *ARMS.values())):
            robots.append(value)
            yield from ((path, text) for text in value.warnings)
    for device in devices:
        for command in device.commands:
            own = next((r for r in robots if set(r.labels) == set(command.labels)), None)
            if own is not None:
                yield from _beyond(profile, f"{device.name}.{command.name}", command, own)


def _beyond(profile: Profile, name: str, command: Command, robot: RobotDescription) -> Iterator[tuple[str, str]]:
    """Bounds of the guard that the arm doesn't have by its description."""
    given = profile.guard.get(name)
    if given is None:
        return
    for key, limit, sign in _BOUNDS:
        if key == "effort" and command.kind is not Kind.TORQUE:
            continue
        value, wider = getattr(given, key, None), []
        for joint, own in zip(robot.labels, getattr(robot, limit).tolist(), strict=True):
            bound = _of(value, joint, command)
            if bound is not None and np.isfinite(own) and sign * bound > sign * own + _ROOM * max(abs(own), 1.0):
                wider.append(f"{joint} {own:g}, and this is {bound:g}")
        if wider:
            yield f"guard.{name}.{key}", f"it is beyond {robot.name}'s: {'; '.join(wider)}"


def _of(value: Any, joint: str, command: Command) -> float | None:
    """A limit of one joint, however the guard was given it."""
    if isinstance(value, dict):
        found = value.get(joint)
        return None if found is None else float(found)
    if isinstance(value, list | tuple):
        place = list(command.labels).index(joint)
        return float(value[place]) if place < len(value) else None
    return float(value) if isinstance(value, int | float) else None
