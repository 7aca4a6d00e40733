"""A Feetech bus' options in the profile."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from srl.drivers.feetech.models import MODELS, Model
from srl.drivers.feetech.table import BAUDS
from srl.drivers.servo_bus.config import ServoBusConfig, ServoConfig

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


class FeetechConfig(ServoBusConfig):
    """Servos on one bus. All arrays have the order of `motors`."""

    baudrate: int = Field(1_000_000, description="bit/s; all servos have the same")
    mode: Mode = Field("position", description="'extended' is position over several turns")
    motors: dict[str, MotorConfig] = Field(min_length=1, description="axes by name")
    driver = "feetech"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.baudrate not in BAUDS:
            raise ValueError(f"no servo has a baud rate of {self.baudrate}; there are {', '.join(map(str, BAUDS))}")
        return self
