"""The options of vibration motors in the profile, and how an intensity becomes a duty."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from srl.drivers.firmata.config import once
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel

PWM_PINS = (3, 5, 6, 9, 10, 11)  # of an ATmega328P board
FULL = 255  # the duty of an output that is always high
LEAST_SPAN = 12  # of FULL, between a motor's start and its full duty


def _with_pwm(pin: int) -> int:
    if pin not in PWM_PINS:
        raise ValueError(f"an ATmega328P board (Uno, Nano) has PWM at the pins {', '.join(map(str, PWM_PINS))}")
    return pin


class MotorConfig(BaseModel):
    """One motor behind a transistor: its pin, and the duties between which it turns."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pin: Annotated[int, AfterValidator(_with_pwm)] = Field(description="3, 5, 6, 9, 10 or 11")
    start: float = Field(0.0, ge=0, lt=1, description="the share of the supply at which it begins to turn")
    full: float = Field(1.0, gt=0, le=1, description="the share of the supply that is its rated voltage")
    on_time: float = Field(20.0, gt=0, le=60, description="s of being on, between pauses of 0.5 s")
    duty: float = Field(0.5, ge=0.2, le=1, description="the mean intensity to which it is bounded over time")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.span < LEAST_SPAN:
            raise ValueError(f"start ({self.start:g}) must be less than full ({self.full:g}), by 0.05 at least")
        return self

    @property
    def span(self) -> int:
        """Duties from the one at which it begins to turn to its greatest."""
        return round(FULL * self.full) - round(FULL * self.start)

    def duty_of(self, intensity: float) -> int:
        """Returns the duty (0 to 255) for an intensity, which is limited to 0 to 1; 0 for what is no number."""
        share = min(intensity, 1.0) * self.span
        return round(round(FULL * self.start) + share) if share >= 0.5 else 0


class VibrationMotorsConfig(DeviceConfig):
    """A board that does nothing else. The command's elements have the order of `motors`."""

    port: str = Field(description="the board's port, e.g. /dev/srl-cuff")
    motors: dict[str, MotorConfig] = Field(min_length=1, max_length=len(PWM_PINS), description="motors by name")

    @model_validator(mode="after")
    def _one_on_each_pin(self) -> Self:
        once((name, motor.pin) for name, motor in self.motors.items())
        return self
