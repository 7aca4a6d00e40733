"""A Feetech bus' options in the profile."""

from __future__ import annotations

from math import pi
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from srl.drivers.dynamixel.config import ServoConfig, calibrated, check_axes
from srl.drivers.feetech.models import MODELS, Model
from srl.drivers.feetech.table import BAUDS
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.servo_record import ServoFile

Mode = Literal["position", "extended"]


class MotorConfig(ServoConfig):
    """One axis and its servo."""

    model: Literal["STS3215", "STS3250"]
    offset: int = Field(
        0, ge=-2047, le=2047, description="counts, the servo's homing offset; a servo with another one is refused"
    )

    @property
    def facts(self) -> Model:
        """The model's data."""
        return MODELS[self.model]


class FeetechConfig(DeviceConfig):
    """Servos on one bus. All arrays have the order of `motors`."""

    port: str = Field(description="the USB adapter's port, tcp://HOST:PORT, spy:FILE:URL")
    baudrate: int = Field(1_000_000, description="bit/s; all servos have the same")
    mode: Mode = Field("position", description="'extended' is position over several turns")
    motors: dict[str, MotorConfig] = Field(min_length=1, description="axes by name")
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

    @model_validator(mode="after")
    def _calibrated(self) -> Self:
        if self.calibration is None:
            return self
        return self.model_copy(update={"motors": calibrated(self.motors, self.calibration, "feetech")})

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_axes(self.motors)
        if self.baudrate not in BAUDS:
            raise ValueError(f"no servo has a baud rate of {self.baudrate}; there are {', '.join(map(str, BAUDS))}")
        return self

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids, in the motors' order."""
        return tuple(motor.id for motor in self.motors.values())
