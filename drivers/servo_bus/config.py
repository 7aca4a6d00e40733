"""Options of a bus of servos and of its axes in the profile."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from math import pi
from typing import Annotated, ClassVar, Self, TypeVar

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from srl.drivers.servo_bus.models import Nominal
from srl.drivers.servo_bus.packets import HIGHEST_ID
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.servo_record import Entry, Line, ServoFile
from srl.runtime.contracts.signals import Limits

Finite = Annotated[float, Field(allow_inf_nan=False)]


class AxisConfig(BaseModel):
    """One axis of a bus of servos or actuators of any maker: how the shaft moves it.

    With the shaft's angle s (rad): axis = ±(s - zero), times `m_per_rad` if it is prismatic.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: int = Field(ge=0, le=HIGHEST_ID, description="on the bus")
    model: str = Field(description="the maker's name of the servo or actuator")
    reversed: bool = Field(False, description="the axis grows as the shaft's angle falls")
    zero: Finite = Field(0.0, description="rad, the shaft's angle where the axis is at 0")
    m_per_rad: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="m/rad of a prismatic axis; its position is then in m"
    )
    lower: Finite | None = Field(None, description="rad or m, lowest position of the axis; none: the servo's own")
    upper: Finite | None = Field(None, description="rad or m, highest position of the axis; none: the servo's own")
    home: Finite | None = Field(None, description="rad or m, where 'retract' goes; give it to all motors or to none")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        return self

    @property
    def scale(self) -> float:
        """Axis motion per shaft motion, with its sign: 1 or -1, m/rad for a prismatic axis."""
        size = 1.0 if self.m_per_rad is None else self.m_per_rad
        return -size if self.reversed else size


class ServoConfig(AxisConfig, ABC):
    """One axis of a bus servo, whose shaft is at 0 at 2048 counts."""

    zero: Finite = Field(0.0, description="rad, the shaft's angle where the axis is at 0; 0 is 2048 counts")
    torque_constant: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="N m/A at the shaft; none: nominal stall torque over stall current"
    )

    @property
    @abstractmethod
    def facts(self) -> Nominal:
        """The model's data."""

    @property
    def entry(self) -> Entry:
        """What a calibration rests on. Bounds and home aren't in it: they are the axis' own."""
        return self.model_dump(include={"id", "model", "reversed", "zero", "m_per_rad", "offset", "reverse_mode"})

    @property
    def mirror(self) -> float:
        """rad: with `reversed` the other way round, an angle has the other sign."""
        return 0.0

    @property
    def bounds(self) -> dict[str, float]:
        """rad, `lower` and `upper` where they are given."""
        return {key: end for key, end in (("lower", self.lower), ("upper", self.upper)) if end is not None}

    def calibrated(self, line: Line) -> Self:
        """The axis as a calibration found it. Its scale is the encoder's."""
        turned = self.reversed != (line.direction < 0)
        trim = -line.trim if turned else line.trim
        return self.model_copy(update={"reversed": turned, "zero": self.zero + trim})

    @property
    def newton_metres(self) -> float:
        """N m/A at the shaft."""
        return self.torque_constant if self.torque_constant is not None else self.facts.torque_constant


A = TypeVar("A", bound=ServoConfig)


def calibrated(axes: Mapping[str, A], file: KeptFile, driver: str) -> dict[str, A]:
    """The axes with what `srl calibrate PROFILE servos` found. Raises ProfileError: the file can't be used."""
    lines = servo_record.lines(file, driver, {name: axis.entry for name, axis in axes.items()})
    return {name: axis.calibrated(lines[name]) if name in lines else axis for name, axis in axes.items()}


def check_axes(axes: Mapping[str, AxisConfig]) -> None:
    """Raises ValueError for an id that is used twice, or a home that some axes lack."""
    taken: dict[int, str] = {}
    for name, axis in axes.items():
        if axis.id in taken:
            raise ValueError(f"id {axis.id} is used twice, by {taken[axis.id]} and {name}")
        taken[axis.id] = name
    homes = [name for name, axis in axes.items() if axis.home is not None]
    if homes and len(homes) < len(axes):
        missing = next(name for name in axes if name not in homes)
        raise ValueError(f"{missing} has no home, others have; give it to all motors or to none")


def bounds(axes: Mapping[str, AxisConfig]) -> Limits:
    """Returns the bounds that the profile gives the axes' positions."""
    lower = np.array([-np.inf if axis.lower is None else axis.lower for axis in axes.values()])
    upper = np.array([np.inf if axis.upper is None else axis.upper for axis in axes.values()])
    return Limits(lower=lower if np.isfinite(lower).any() else None, upper=upper if np.isfinite(upper).any() else None)


class ServoBusConfig(DeviceConfig):
    """Servos on one bus. All arrays have the order of `motors`."""

    port: str = Field(description="the USB adapter's port, tcp://HOST:PORT, spy:FILE:URL")
    baudrate: int = Field(description="bit/s; all servos have the same")
    motors: Mapping[str, ServoConfig] = Field(min_length=1, description="axes by name")
    return_delay: float | None = Field(
        0.0, ge=0, le=508e-6, description="s a servo waits before it answers; none: left as it is"
    )
    start_tolerance: float = Field(
        0.1, gt=0, le=pi, description="rad of the shaft; a servo whose command is farther off gets no torque"
    )
    calibration: ServoFile | None = Field(
        None, description="file of `srl calibrate PROFILE servos`: other `zero` and `reversed` than said here"
    )
    jointed: ClassVar[str] = "motors"  # where the entries of the joints are
    driver: ClassVar[str]  # its name, as in a calibration

    @model_validator(mode="after")
    def _calibrated(self) -> Self:
        if self.calibration is None:
            return self
        return self.model_copy(update={"motors": calibrated(self.motors, self.calibration, self.driver)})

    @model_validator(mode="after")
    def _of_axes(self) -> Self:
        check_axes(self.motors)
        return self

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids, in the motors' order."""
        return tuple(motor.id for motor in self.motors.values())
