"""A Dynamixel bus' options in the profile."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from srl.drivers.dynamixel.models import MODELS, Model
from srl.drivers.dynamixel.table import baud_code
from srl.drivers.servo_bus.config import ServoBusConfig, ServoConfig

Mode = Literal["position", "extended", "velocity", "effort"]


class MotorConfig(ServoConfig):
    """One axis and its MX servo."""

    model: Literal["MX-28", "MX-64", "MX-106"]
    offset: int = Field(0, ge=-1_044_479, le=1_044_479, description="counts, the servo's homing offset")
    reverse_mode: bool = Field(False, description="the servo's drive mode is reverse")

    @property
    def facts(self) -> Model:
        """The model's data."""
        return MODELS[self.model]


class DynamixelConfig(ServoBusConfig):
    """Servos on one bus. All arrays have the order of `motors`."""

    baudrate: int = Field(57600, gt=0, le=4_500_000, description="bit/s; all servos have the same")
    protocol: Literal[1, 2] = Field(2, description="of the servos' firmware: MX is delivered with 1, MX(2.0) with 2")
    mode: Mode = Field("position", description="what is commanded; 'extended' is position over several turns")
    motors: dict[str, MotorConfig] = Field(min_length=1, description="axes by name")
    watchdog: float = Field(
        0.1, ge=0.02, le=2.54, description="s without a word after which the servos stop by themselves (protocol 2)"
    )
    configure: bool = Field(True, description="set operating mode and return delay where they differ; else refuse")
    driver = "dynamixel"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for name, motor in self.motors.items():
            if self.protocol == 1 and motor.offset:
                raise ValueError(f"{name}: 'offset' is for protocol 2")
            if self.mode == "position" and abs(motor.offset) > 1024:
                raise ValueError(
                    f"{name}: over one turn a servo ignores an offset beyond 1024 counts; this is {motor.offset}"
                )
            if self.mode == "effort" and not motor.facts.senses_current:
                raise ValueError(f"{name} is an {motor.model}, which has no current control; 'effort' needs it")
        if baud_code(self.baudrate, self.protocol) is None:
            raise ValueError(f"no servo of protocol {self.protocol} has a baud rate of {self.baudrate}")
        return self

    @property
    def command(self) -> str:
        """The name of the command signal."""
        return "position_command" if self.mode in ("position", "extended") else f"{self.mode}_command"
