"""A Dynamixel bus' options in the profile."""

from __future__ import annotations

from typing import Final, Literal, Self

from pydantic import Field, model_validator

from srl.drivers.dynamixel.models import MODELS, Model, ModelName
from srl.drivers.dynamixel.table import BAUDS2, baud_code
from srl.drivers.servo_bus.config import ServoBusConfig, ServoConfig
from srl.runtime.contracts.errors import OptionError

Mode = Literal["position", "extended", "current-position", "velocity", "effort"]
POSITIONAL: Final = ("position", "extended", "current-position")  # modes whose command is a position


class MotorConfig(ServoConfig):
    """One axis and its servo; of a servo with two axes, one of them."""

    model: ModelName
    offset: int = Field(0, ge=-1_044_479, le=1_044_479, description="counts, the servo's homing offset")
    reverse_mode: bool = Field(False, description="the servo's drive mode is reverse")
    effort: float | None = Field(
        None,
        gt=0,
        allow_inf_nan=False,
        description="N m or N, the most that the axis pushes in 'current-position'",
    )

    @property
    def facts(self) -> Model:
        """The model's data."""
        return MODELS[self.model]


class DynamixelConfig(ServoBusConfig):
    """Servos on one bus. All arrays have the order of `motors`."""

    baudrate: int = Field(57600, gt=0, le=4_500_000, description="bit/s; all servos have the same")
    protocol: Literal[1, 2] = Field(2, description="of the servos' firmware: MX is delivered with 1, others with 2")
    mode: Mode = Field("position", description="what is commanded; see docs/devices/dynamixel.md")
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
            self._can(name, motor)
        if baud_code(self.baudrate, self.protocol) is None:
            raise ValueError(f"no servo of protocol {self.protocol} has a baud rate of {self.baudrate}")
        return self

    def _can(self, name: str, motor: MotorConfig) -> None:
        """Raises OptionError: motor `name` can't do what the bus asks."""
        model = motor.facts
        if not model.number(self.protocol):
            raise OptionError(
                f"{name}: the driver talks to an {model.name} in protocol 2 only",
                "Set 'protocol: 2', and the servo's protocol type to 2 with the vendor's DYNAMIXEL Wizard",
            )
        if self.mode not in model.modes:
            raise OptionError(
                f"{name}: {model.name} has no current control, which mode '{self.mode}' needs",
                f"Choose {', '.join(model.modes)}, or another model",
            )
        if self.protocol == 1 and self.mode == "current-position":
            raise OptionError(f"{name}: mode 'current-position' is for protocol 2", "Choose position or extended")
        code = baud_code(self.baudrate, self.protocol)
        if self.protocol == 2 and code is not None and code > model.series.bauds:
            fastest = BAUDS2[model.series.bauds]
            raise OptionError(
                f"{name}: {model.name} has no baud rate of {self.baudrate}", f"Set at most {fastest} in all servos"
            )
        self._pushes(name, motor)

    def _pushes(self, name: str, motor: MotorConfig) -> None:
        if self.mode != "current-position":
            if motor.effort is not None:
                raise OptionError(
                    f"{name}: 'effort' bounds mode 'current-position', this is '{self.mode}'", "Leave it out"
                )
            return
        unit = motor.newton_metres * motor.facts.current_unit / abs(motor.scale)
        most = motor.facts.current_limit * unit
        if motor.effort is None:
            raise OptionError(f"{name}: mode 'current-position' needs 'effort'", f"Set up to {most:.3g}")
        if not unit <= motor.effort <= most:
            raise OptionError(
                f"{name}: {motor.model} can't bound its effort to {motor.effort:g}", f"Set {unit:.2g} to {most:.3g}"
            )

    @property
    def command(self) -> str:
        """The name of the command signal."""
        return "position_command" if self.mode in POSITIONAL else f"{self.mode}_command"
