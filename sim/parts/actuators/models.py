"""What the simulation assumes of each actuator.

Round figures near the makers' product pages; nobody measured them here, and no protocol sheet gives them. They decide
how a simulated limb feels, never what a driver sends: the ranges of the wire are the drivers' own.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Final, Literal

Encoder = Literal["rotor", "output"]


@dataclass(frozen=True)
class ActuatorModel:
    """One model, at its output shaft.

    Attributes:
        name: the maker's name.
        gear: reduction.
        peak_torque: N m.
        no_load_speed: rad/s at `nominal_voltage`.
        kt: N m/A at the rotor.
        rotor_inertia: kg m^2 at the rotor.
        pole_pairs: of the rotor.
        mass: kg.
        encoder: what is known of the angle after power-up: "rotor" only within a turn of the rotor, "output" within a
            turn of the output shaft.
        nominal_voltage: V.
    """

    name: str
    gear: float
    peak_torque: float
    no_load_speed: float
    kt: float
    rotor_inertia: float
    pole_pairs: int
    mass: float
    encoder: Encoder
    nominal_voltage: float

    @property
    def torque_constant(self) -> float:
        """N m/A at the output shaft."""
        return self.kt * self.gear

    @property
    def stall_torque(self) -> float:
        """N m: the most torque that the drive gives."""
        return self.peak_torque

    @property
    def stall_current(self) -> float:
        """A, at the most torque."""
        return self.peak_torque / self.torque_constant

    @property
    def inertia(self) -> float:
        """kg m^2, the rotor's inertia seen at the output shaft."""
        return self.rotor_inertia * self.gear**2

    @property
    def ambiguity(self) -> float:
        """rad: after power-up the angle is known up to whole multiples of this."""
        return 2 * pi / self.gear if self.encoder == "rotor" else 2 * pi


def _ak(
    name: str, gear: float, torque: float, speed: float, kt: float, inertia: float, mass: float, pole_pairs: int = 21
) -> ActuatorModel:
    return ActuatorModel(name, gear, torque, speed, kt, inertia, pole_pairs, mass, "rotor", 48.0)


def _dm(
    name: str, gear: float, torque: float, speed: float, kt: float, inertia: float, mass: float, voltage: float = 24.0
) -> ActuatorModel:
    return ActuatorModel(name, gear, torque, speed, kt, inertia, 14, mass, "output", voltage)


MODELS: Final = {
    model.name: model
    for model in (
        _ak("AK10-9", 9, 48, 24, 0.160, 1.0e-4, 0.96),
        _ak("AK60-6", 6, 9, 44, 0.113, 2.4e-5, 0.32, 14),
        _ak("AK70-10", 10, 25, 42, 0.095, 4.1e-5, 0.52),
        _ak("AK80-6", 6, 12, 60, 0.091, 6.0e-5, 0.49),
        _ak("AK80-8", 8, 25, 30, 0.136, 6.0e-5, 0.57),
        _ak("AK80-9", 9, 18, 45, 0.091, 6.0e-5, 0.49),
        _ak("AK80-64", 64, 120, 6, 0.119, 5.6e-5, 0.85),
        _dm("DM3507", 7, 3, 40, 0.06, 5.0e-6, 0.16),
        _dm("DM4310", 10, 7, 21, 0.095, 1.5e-5, 0.30),
        _dm("DM4310-48V", 10, 7, 42, 0.095, 1.5e-5, 0.30, 48.0),
        _dm("DM4340", 40, 27, 5.5, 0.095, 1.5e-5, 0.36),
        _dm("DM4340-48V", 40, 27, 10, 0.095, 1.5e-5, 0.36, 48.0),
        _dm("DM6006", 6, 11, 25, 0.10, 6.0e-5, 0.38),
        _dm("DM8006", 6, 20, 18, 0.14, 1.5e-4, 0.80, 48.0),
        _dm("DM8009", 9, 40, 15, 0.14, 1.5e-4, 0.90, 48.0),
        _dm("DM10010", 10, 120, 10, 0.20, 3.0e-4, 1.40, 48.0),
        _dm("DM10010L", 10, 120, 15, 0.20, 3.0e-4, 1.40, 48.0),
        ActuatorModel("ODrive-8", 8, 30, 25, 0.083, 1.0e-4, 20, 0.90, "rotor", 48.0),  # a motor of 100 rpm/V, geared
    )
}
