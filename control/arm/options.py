"""Options that have a value for each joint of an arm, by name or one for all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.per_element import in_order
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.models.robots import RobotDescription


def each(given: Mapping[str, float] | float, robot: RobotDescription, key: str) -> Array:
    """(n,) in the joints' order. Raises OptionError: joints are missing or unknown."""
    try:
        return np.array(in_order(given, robot.labels), dtype=float)
    except OptionError as error:
        raise OptionError(f"{key}: {error.problem}", error.remedy) from None


def joints(robot: RobotDescription, name: str, unit: str) -> Signal:
    """A signal (n,) of the arm's joints; `unit` is that of joints that turn."""
    if len(robot.slides) == robot.n:
        unit = {"rad": "m", "rad/s": "m/s", "N m": "N"}[unit]
    return Signal(name=name, shape=(robot.n,), unit=unit, labels=robot.labels, slides=robot.slides)
