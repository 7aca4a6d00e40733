"""The servos this driver knows, with nominal values at 12 V (docs/devices/feetech.md says whose)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final


@dataclass(frozen=True)
class Model:
    """One model.

    Attributes:
        name: the vendor's name.
        number: model number, registers 3 and 4.
        series: "STS" has words with the low byte first and a sync read; "SCS" has neither.
        stall_torque: N m at 12 V.
        stall_current: A at 12 V.
        no_load_speed: rad/s at 12 V.
        mass: kg.
        nominal_voltage: V, of the supply for which these values are.
    """

    name: str
    number: int
    series: str
    stall_torque: float
    stall_current: float
    no_load_speed: float
    mass: float
    nominal_voltage: float = 12.0

    @property
    def torque_constant(self) -> float:
        """N m/A at the shaft, gears included: nominal stall torque over stall current."""
        return self.stall_torque / self.stall_current


_KG_CM: Final = 0.0980665  # N m

MODELS: Final = {
    model.name: model
    for model in (
        Model("STS3215", 777, "STS", 30 * _KG_CM, 2.7, 45 * pi / 30, 0.055),
        Model("STS3250", 2825, "STS", 50 * _KG_CM, 3.8, pi / 3 / 0.133, 0.075),
    )
}
STRANGERS: Final = {1284: "SCS0009"}  # models that can be told, but not driven


def called(number: int) -> str:
    """Returns a model number in words."""
    name = next((model.name for model in MODELS.values() if model.number == number), STRANGERS.get(number))
    return f"{name} (model number {number})" if name else f"model number {number}"
