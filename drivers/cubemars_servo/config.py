"""Options of CubeMars AK actuators in servo mode in the profile."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from srl.drivers.can_axes.config import CanAxesConfig, CanAxis, Finite, Positive
from srl.drivers.cubemars_servo.models import MODELS, Model

DEGREES = 57.29577951308232


class ServoAxis(CanAxis):
    """One axis and its actuator."""

    id: int = Field(ge=1, le=255, description="of the drive; 104 as delivered")
    model: Literal["AK10-9", "AK60-6", "AK70-10", "AK80-6", "AK80-8", "AK80-9", "AK80-64"]
    zero: Finite = Field(0.0, description="rad, the shaft's angle (0 at its origin) where the axis is at 0")
    parked: Finite = Field(description="rad, where the axis stands when it is switched on and when a run opens")
    lower: Finite = Field(description="rad, lowest position of the axis")
    upper: Finite = Field(description="rad, highest position of the axis")
    acceleration: Positive = Field(description="rad/s^2, the drive's own ramp, with `mode: position`")
    current: float = Field(gt=0, le=60, allow_inf_nan=False, description="A, most that is commanded and braked with")
    torque_constant: Positive = Field(description="N m/A at the output shaft: the motor's constant times the gear")
    pole_pairs: int | None = Field(None, ge=1, le=100, description="none: the model's")

    @model_validator(mode="after")
    def _within_its_numbers(self) -> Self:
        for name, value in (("lower", self.lower), ("upper", self.upper), ("parked", self.parked)):
            if abs(self.sign * value + self.zero) * DEGREES > 3200:
                raise ValueError(f"'{name}' is beyond 3200 degrees of the shaft, which a status can't say")
        if not self.lower <= self.parked <= self.upper:
            raise ValueError(f"'parked' ({self.parked:g}) must lie between 'lower' and 'upper'")
        return self

    @property
    def number(self) -> int:
        return self.id

    @property
    def most_torque(self) -> float:
        return self.current * self.torque_constant

    @property
    def place(self) -> float | None:
        return self.parked

    @property
    def facts(self) -> Model:
        """The model's data, with the profile's pole pairs."""
        model = MODELS[self.model]
        return Model(model.gear, self.pole_pairs) if self.pole_pairs is not None else model


class CubemarsServoConfig(CanAxesConfig):
    """CubeMars AK actuators in servo mode on one CAN bus."""

    timeout: float = Field(
        gt=0, le=60, description="s of silence after which the drives let go, as set with the maker's program; nothing "
        "on the bus sets or reads it",
    )  # fmt: skip
    status_rate: int = Field(
        100, ge=1, le=500, description="Hz of each drive's status, as set with the maker's program; it isn't set"
    )
    axes: dict[str, ServoAxis] = Field(min_length=1, description="axes by name")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self.check_axes()
        return self

    @property
    def all_axes(self) -> dict[str, ServoAxis]:
        return self.axes
