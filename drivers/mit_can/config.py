"""The options of MIT-mode actuators in the profile."""

from __future__ import annotations

from math import pi
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from srl.drivers.mit_can.models import MODELS, Generation, Maker, Model, Range
from srl.drivers.mit_can.protocol import KD_MAX, KP_MAX, TICK, V3_STATUS
from srl.drivers.servo_bus.config import AxisConfig, check_axes
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.errors import OptionError, nearest

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
MARGIN = 0.1  # rad kept free at the ends of the wire's range, where a position wraps


class RangeConfig(DeviceConfig):
    """The ranges of a motor's wire."""

    position: Positive = Field(description="rad")
    velocity: Positive = Field(description="rad/s")
    torque: Positive = Field(description="N m")


class MotorConfig(AxisConfig):
    """One axis and its actuator. Gains and torques are those of the actuator's output shaft."""

    id: int = Field(ge=1, le=127, description="to which it listens; a Damiao's ESC_ID, 1 to 15")
    reply: int | None = Field(
        None, ge=0, le=0x7FE, description="identifier of a Damiao's replies, its MST_ID; none: id + 0x10"
    )
    serial: int | None = Field(None, ge=0, description="of a Damiao: another one at this id is refused")
    zero: float = Field(0.0, allow_inf_nan=False, description="rad, the shaft's angle where the axis is at 0")
    kp: float = Field(0.0, ge=0, le=KP_MAX, description="N m/rad, of the position interface")
    kd: float = Field(0.0, ge=0, le=KD_MAX, description="N m s/rad, of any interface")
    damping: float = Field(2.0, gt=0, le=KD_MAX, description="N m s/rad, of a damped stop")
    range: RangeConfig | None = Field(
        None, description="none: the model's; of a Damiao what it says itself, which must be this"
    )
    encoder: Literal["rotor", "output"] | None = Field(
        None, description="what is known after power-up: the angle within a turn of rotor or output; none: the maker's"
    )
    park: float | None = Field(
        None, allow_inf_nan=False, description="rad or m, where the axis rests when its drive gets power"
    )

    @property
    def facts(self) -> Model:
        """The model's data."""
        return MODELS[self.model]

    def span(self, generation: Generation) -> Range:
        """The ranges of the wire, as far as the profile decides."""
        if self.range is not None:
            return Range(self.range.position, self.range.velocity, self.range.torque)
        return self.facts.ranges[generation][0]

    @property
    def turn(self) -> float | None:
        """rad of the shaft up to whose multiples the angle is known after power-up; None: no source is at hand."""
        encoder = self.encoder or ("output" if self.facts.maker == "damiao" else "rotor")
        return 2 * pi if encoder == "output" else self.facts.rotor_turn


class MitCanConfig(DeviceConfig):
    """MIT-mode actuators of one maker and firmware on one CAN bus. All arrays have the order of `motors`."""

    port: str = Field(description="can://INTERFACE/CHANNEL, e.g. can://socketcan/can0")
    bitrate: int = Field(1_000_000, gt=0, description="bit/s, as the bus is set up; for what it can carry")
    maker: Maker
    firmware: Literal["v1", "v2", "v3"] | None = Field(
        None, description="of a CubeMars: v3 has another layout, in which an older command is a gain"
    )
    interface: Literal["position", "velocity", "torque"] = Field("position", description="what is commanded")
    motors: dict[str, MotorConfig] = Field(min_length=1, description="axes by name")
    watchdog: float = Field(
        0.5, ge=0.02, le=10, description="s without a command after which a Damiao goes limp by itself"
    )
    enable_at_open: bool = Field(
        False,
        description="a CubeMars V1 or V2 tells its state only when enabled: enable it at open, with damping alone",
    )
    ramp: float = Field(0.5, ge=0, le=10, description="s in which the stiffness rises after a start")
    start_tolerance: float = Field(
        0.1, gt=0, le=pi, description="rad of the shaft; a motor whose first command is farther off is refused"
    )
    hot: float = Field(90.0, gt=0, le=150, description="degC of a Damiao's winding or power stage that stops the limb")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_axes(self.motors)
        if (self.firmware is None) != (self.maker == "damiao"):
            if self.firmware is None:
                problem, remedy = "the firmware of a CubeMars isn't said", "Add 'firmware: v1', 'v2' or 'v3'"
            else:
                problem, remedy = "a Damiao has no firmware generation", "Remove 'firmware'"
            raise OptionError(problem, remedy)
        for name, motor in self.motors.items():
            self._check(name, motor)
        replies = [self.reply_id(motor) for motor in self.motors.values()]
        for name, motor in self.motors.items():
            mine = self.reply_id(motor)
            taken = mine in self.ids or replies.count(mine) > 1
            if self.maker == "damiao" and taken:
                raise OptionError(
                    f"{name} replies on {mine:#x}, which another motor uses", "Give each a 'reply' of its own"
                )
        return self

    def _check(self, name: str, motor: MotorConfig) -> None:
        known = [model.name for model in MODELS.values() if model.maker == self.maker]
        if motor.model not in known:
            raise OptionError(f"{name}: there is no {self.maker} '{motor.model}'", nearest(motor.model, known))
        if self.generation not in motor.facts.ranges and motor.range is None:
            raise OptionError(
                f"{name}: no source gives the ranges of an {motor.model} with firmware {self.firmware}",
                "Add 'range: {position: .., velocity: .., torque: ..}' from its parameter page",
            )
        if self.maker == "damiao" and motor.id > 15:
            raise OptionError(f"{name}: id {motor.id} doesn't fit a Damiao's replies", "Give it an id of 1 to 15")
        if self.maker != "damiao" and (motor.reply is not None or motor.serial is not None):
            raise OptionError(f"{name}: a CubeMars has no 'reply' or 'serial' to compare", "Remove it")
        if self.interface == "position" and (motor.kp <= 0 or motor.kd <= 0):
            raise OptionError(
                f"{name}: position needs kp and kd above 0; without kd the joint would oscillate",
                "Begin with a tenth of what holds the limb, e.g. kp: 20, kd: 0.5",
            )
        if self.interface == "velocity" and motor.kd <= 0:
            raise OptionError(f"{name}: velocity needs kd above 0", "Begin with kd: 0.5")
        if motor.lower is None or motor.upper is None:
            raise OptionError(
                f"{name}: its travel isn't said", "Add 'lower' and 'upper', also to tell its turn after power-up"
            )
        reach = motor.span(self.generation).position - MARGIN
        for key in ("lower", "upper"):
            value = getattr(motor, key)
            if value is not None and abs(value / motor.scale + motor.zero) > reach:
                raise OptionError(
                    f"{name}: '{key}' is {value / motor.scale + motor.zero:.2f} rad at the shaft, the wire carries "
                    f"±{reach:g}",
                    "Move the motor's zero, or correct 'lower', 'upper' or 'zero'",
                )

    @property
    def generation(self) -> Generation:
        """The firmware generation."""
        return "damiao" if self.firmware is None else self.firmware

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids, in the motors' order."""
        return tuple(motor.id for motor in self.motors.values())

    def reply_id(self, motor: MotorConfig) -> int:
        """The identifier that a motor replies on."""
        if self.generation == "v3":
            return V3_STATUS + motor.id
        if self.maker == "damiao":
            return motor.id + 0x10 if motor.reply is None else motor.reply
        return motor.id  # or 0: section 1.4

    @property
    def watchdog_ticks(self) -> int:
        """The watchdog in the unit of its register."""
        return round(self.watchdog / TICK)
