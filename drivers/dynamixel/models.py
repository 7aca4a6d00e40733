"""The supported servos, with the vendor's nominal values at 12 V (fact sheet dynamixel_mx)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final


@dataclass(frozen=True)
class Model:
    """One model.

    Attributes:
        name: the vendor's name.
        number1, number2: model number with firmware of protocol 1, and of protocol 2.
        gear: reduction.
        stall_torque: N m at 12 V.
        stall_current: A at 12 V.
        no_load_speed: rad/s at 12 V.
        senses_current: whether it measures its current, and can control it.
        current_limit: A, the register's default; 0 if there is none.
        velocity_limit: 0.229 rpm, the register's default with firmware of protocol 2.
        mass: kg.
    """

    name: str
    number1: int
    number2: int
    gear: int
    stall_torque: float
    stall_current: float
    no_load_speed: float
    senses_current: bool
    current_limit: int
    velocity_limit: int
    mass: float

    @property
    def torque_constant(self) -> float:
        """N m/A at the shaft, gears included: nominal stall torque over stall current."""
        return self.stall_torque / self.stall_current

    def number(self, protocol: int) -> int:
        """Returns the model number."""
        return self.number1 if protocol == 1 else self.number2


def _rpm(value: float) -> float:
    return value * 2 * pi / 60


MODELS: Final = {
    model.name: model
    for model in (
        Model("MX-28", 29, 30, 193, 2.5, 1.4, _rpm(55), False, 0, 230, 0.072),
        Model("MX-64", 310, 311, 200, 6.0, 4.1, _rpm(63), True, 1941, 285, 0.126),
        Model("MX-106", 320, 321, 225, 8.4, 5.2, _rpm(45), True, 2047, 210, 0.153),
    )
}

BY_NUMBER: Final = {number: model for model in MODELS.values() for number in (model.number1, model.number2)}


def called(number: int) -> str:
    """Returns the name for a model number, for messages."""
    model = BY_NUMBER.get(number)
    return f"{model.name} (model number {number})" if model else f"model number {number}"
