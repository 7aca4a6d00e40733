"""A servo's encoder, and the nominal values that every model has."""

from __future__ import annotations

from math import pi
from typing import Final, Protocol

COUNTS: Final = 4096  # per turn
CENTRE: Final = 2048  # counts, zero of the shaft's angle
PER_COUNT: Final = 2 * pi / COUNTS  # rad


class Nominal(Protocol):
    """The nominal values of any bus servo: N m, A, rad/s, kg, N m/A, and V of the supply that they are for."""

    @property
    def name(self) -> str: ...

    @property
    def stall_torque(self) -> float: ...

    @property
    def stall_current(self) -> float: ...

    @property
    def no_load_speed(self) -> float: ...

    @property
    def nominal_voltage(self) -> float: ...

    @property
    def mass(self) -> float: ...

    @property
    def torque_constant(self) -> float: ...
