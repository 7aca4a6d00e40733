"""The supported servos: what the maker's e-manual says of each, and what their control tables differ in.

Source: github.com/ROBOTIS-GIT/emanual, docs/en/dxl/x and docs/en/dxl/mx. Torque, current and speed are the values at
`nominal_voltage`, the supply that the maker recommends. docs/devices/dynamixel.md says which models are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import Annotated, Final, NamedTuple

from pydantic import AfterValidator, Field

from srl.runtime.contracts.errors import OptionError, nearest

_LOAD: Final = 1e-3  # of the stall current, per unit of a servo's load


class Gains(NamedTuple):
    """The registers' defaults with firmware of protocol 2."""

    position_p: int = 800
    position_i: int = 0
    position_d: int = 0
    velocity_p: int = 100
    velocity_i: int = 1920


@dataclass(frozen=True)
class Series:
    """What several models have in common.

    Attributes:
        current_unit: A of one unit of a current with protocol 2; 0 if the servo has no current sensor.
        nominal_voltage: V, of the supply.
        voltages: 0.1 V, defaults of the registers for the lowest and the highest supply.
        voltage_range: 0.1 V, what these registers take.
        temperature: degC, default of the temperature limit.
        shutdown: default of the mask of errors that end the torque.
        velocity_range: 0.229 rpm, the highest velocity limit.
        bauds: highest code of the baud rate.
        indirect: (first address, first data, number) of the indirect registers.
        slope: default of the PWM slope; 0 if there is none.
        acceleration_limit, ports, led: whether it has these registers.
    """

    current_unit: float = 2.69e-3
    nominal_voltage: float = 12.0
    voltages: tuple[int, int] = (95, 160)
    voltage_range: tuple[int, int] = (95, 160)
    temperature: int = 80
    shutdown: int = 0x34
    velocity_range: int = 1023
    bauds: int = 7
    indirect: tuple[tuple[int, int, int], ...] = ((168, 224, 28), (578, 634, 28))
    slope: int = 0
    acceleration_limit: bool = False
    ports: bool = False
    led: bool = True


@dataclass(frozen=True)
class Model:
    """One model.

    Attributes:
        name: the vendor's name, without the letter of its bus.
        number1, number2: model number with firmware of protocol 1 (0: the driver has none), and of protocol 2.
        gear: reduction.
        stall_torque: N m at `nominal_voltage`, as the next two.
        stall_current: A.
        no_load_speed: rad/s.
        current_limit: the register's default and its highest value; 0 if there is none.
        velocity_limit: 0.229 rpm, the register's default with firmware of protocol 2.
        mass: kg; of a servo with two axes, half of it.
        series: what it has in common with others.
        gains: with firmware of protocol 2.
    """

    name: str
    number1: int
    number2: int
    gear: float
    stall_torque: float
    stall_current: float
    no_load_speed: float
    current_limit: int
    velocity_limit: int
    mass: float
    series: Series
    gains: Gains

    @property
    def senses_current(self) -> bool:
        """Whether it measures its current, and can control it."""
        return self.current_limit > 0

    @property
    def current_unit(self) -> float:
        """A of one unit of its current with protocol 2; of its load, if it measures none."""
        return self.series.current_unit or self.stall_current * _LOAD

    @property
    def nominal_voltage(self) -> float:
        """V, of the supply for which its values are."""
        return self.series.nominal_voltage

    @property
    def torque_constant(self) -> float:
        """N m/A at the shaft, gears included: nominal stall torque over stall current."""
        return self.stall_torque / self.stall_current

    @property
    def modes(self) -> tuple[str, ...]:
        """The driver's modes that it has."""
        with_current = ("effort", "current-position") if self.senses_current else ()
        return ("position", "extended", "velocity", *with_current)

    def number(self, protocol: int) -> int:
        """Returns the model number."""
        return self.number1 if protocol == 1 else self.number2


def _rpm(value: float) -> float:
    return value * 2 * pi / 60


# An MX-28 has no current sensor; its unit only rounds what the simulation shows as its load.
_MX: Final = Series(current_unit=3.36e-3, acceleration_limit=True)
_SMALL: Final = Series(  # XL330, XC330-M
    current_unit=1e-3, nominal_voltage=5.0, voltages=(35, 70), voltage_range=(31, 70), temperature=70,
    velocity_range=2047, bauds=6, indirect=((168, 208, 20),), slope=140,
)  # fmt: skip
_XL330: Final = replace(_SMALL, shutdown=0x35)
_XC330T: Final = replace(_SMALL, nominal_voltage=11.1, voltages=(55, 140), voltage_range=(55, 140), slope=255)
_XL430: Final = Series(0.0, 11.1, voltages=(60, 140), voltage_range=(60, 140), temperature=72)
_XC430: Final = Series(0.0, voltages=(60, 160), voltage_range=(60, 160))
_430: Final = Series()
_540: Final = Series(ports=True)
_XW: Final = Series(led=False)
_430V: Final = Series(1.34e-3, 24.0, (110, 300), (110, 300))
_540V: Final = Series(2.69e-3, 24.0, (110, 300), (110, 300), ports=True)


_PLAIN: Final = Gains()


def _x(
    name: str, number: int, gear: float, torque: float, current: float, rpm: float, grams: float, velocity: int,
    series: Series, limit: int = 0, gains: Gains = _PLAIN,
) -> Model:  # fmt: skip
    """A model that has firmware of protocol 2 only, in N m, A, rpm, g."""
    return Model(name, 0, number, gear, torque, current, _rpm(rpm), limit, velocity, grams / 1000, series, gains)


_P900: Final = Gains(900)
_XC330T_GAINS: Final = Gains(900, velocity_p=40, velocity_i=1200)

MODELS: Final = {
    model.name: model
    for model in (
        Model("MX-28", 29, 30, 193, 2.5, 1.4, _rpm(55), 0, 230, 0.072, _MX, Gains(850)),
        Model("MX-64", 310, 311, 200, 6.0, 4.1, _rpm(63), 1941, 285, 0.126, _MX, Gains(850)),
        Model("MX-106", 320, 321, 225, 8.4, 5.2, _rpm(45), 2047, 210, 0.153, _MX, Gains(850)),
        _x("XL330-M077", 1190, 77.5, 0.215, 1.47, 383, 18, 1620, _XL330, 1750, Gains(400, 400, 0, 40, 400)),
        _x("XL330-M288", 1200, 288.4, 0.52, 1.47, 103, 18, 445, _XL330, 1750, Gains(400, 0, 0, 180, 1600)),
        _x("XC330-M181", 1230, 180.62, 0.60, 1.80, 129, 23, 545, _SMALL, 2352, Gains(1200, 0, 500, 100, 1400)),
        _x("XC330-M288", 1240, 288.35, 0.93, 1.80, 81, 23, 350, _SMALL, 2352, Gains(1100, 0, 500, 50, 1600)),
        _x("XC330-T181", 1210, 180.62, 0.76, 0.80, 104, 23, 510, _XC330T, 910, _XC330T_GAINS),
        _x("XC330-T288", 1220, 288.35, 0.92, 0.80, 65, 23, 320, _XC330T, 910, _XC330T_GAINS),
        _x("XL430-W250", 1060, 258.5, 1.4, 1.3, 57, 57.2, 265, _XL430, gains=Gains(640, 0, 4000, 100, 1000)),
        _x("2XL430-W250", 1090, 257.4, 1.4, 1.3, 57, 49.1, 250, _XL430, gains=Gains(640, 0, 2000, 100, 1800)),
        _x("XC430-W150", 1070, 159.59, 1.6, 1.4, 106, 65, 460, _XC430, gains=Gains(460)),
        _x("XC430-W240", 1080, 245.22, 1.9, 1.4, 70, 65, 306, _XC430, gains=Gains(700)),
        _x("2XC430-W250", 1160, 257.4, 1.8, 1.4, 64, 51, 275, _XC430, gains=Gains(700)),
        _x("XM430-W210", 1030, 212.6, 3.0, 2.3, 77, 82, 330, _430, 1193),
        _x("XM430-W350", 1020, 353.5, 4.1, 2.3, 46, 82, 200, _430, 1193),
        _x("XM540-W150", 1130, 152.3, 7.3, 4.4, 53, 165, 230, _540, 2047),
        _x("XM540-W270", 1120, 272.5, 10.6, 4.4, 30, 165, 128, _540, 2047),
        _x("XH430-W210", 1010, 212.6, 2.5, 1.3, 50, 82, 210, _430, 648, _P900),
        _x("XH430-W350", 1000, 353.5, 3.4, 1.3, 30, 82, 130, _430, 648, _P900),
        _x("XH430-V210", 1050, 212.6, 2.6, 0.7, 52, 82, 380, _430V, 689),
        _x("XH430-V350", 1040, 353.5, 3.3, 0.7, 31, 82, 135, _430V, 689),
        _x("XH540-W150", 1110, 152.3, 7.1, 4.9, 70, 165, 300, _540, 2047),
        _x("XH540-W270", 1100, 272.5, 9.9, 4.9, 39, 165, 167, _540, 2047),
        _x("XH540-V150", 1150, 152.3, 6.4, 2.4, 60, 165, 230, _540V, 2047),
        _x("XH540-V270", 1140, 272.5, 9.2, 2.4, 34, 165, 128, _540V, 2047),
        _x("XD430-T210", 1011, 212.6, 2.5, 1.3, 50, 85, 210, _430, 648, _P900),
        _x("XD430-T350", 1001, 353.5, 3.4, 1.3, 30, 85, 130, _430, 648, _P900),
        _x("XD540-T150", 1111, 152.3, 7.1, 4.9, 70, 170, 300, _540, 2047),
        _x("XD540-T270", 1101, 272.5, 9.9, 4.9, 39, 170, 167, _540, 2047),
        _x("XW430-T200", 1280, 200.1, 2.3, 1.3, 53, 96, 235, _XW, 2047, _P900),
        _x("XW430-T333", 1270, 332.8, 3.1, 1.3, 31, 96, 139, _XW, 2047, _P900),
        _x("XW540-T140", 1180, 145.6, 6.9, 4.9, 72, 185, 304, _XW, 2047),
        _x("XW540-T260", 1170, 260.6, 9.5, 4.9, 40, 185, 167, _XW, 2047),
    )
}

BY_NUMBER: Final = {number: model for model in MODELS.values() for number in (model.number1, model.number2) if number}


def _known(name: str) -> str:
    if name not in MODELS:
        raise OptionError(f"the driver knows no servo '{name}'", nearest(name, MODELS))
    return name


ModelName = Annotated[str, AfterValidator(_known), Field(json_schema_extra={"enum": list(MODELS)})]
"""The name of a model in a profile."""


def called(number: int) -> str:
    """Returns the name for a model number, for messages."""
    model = BY_NUMBER.get(number)
    return f"{model.name} (model number {number})" if model else f"model number {number}"
