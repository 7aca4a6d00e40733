"""A Firmata board's options in the profile, and how its servos' pulses relate to angles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, ConfigDict, Field, ValidationError, model_validator

from srl.drivers.firmata.protocol import MAX_SERVOS, MIN_PULSE_US
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.servo_record import Entry, Line, ServoFile
from srl.runtime.contracts.validation import refusal

MAX_PULSE_US = 2400
DRIVER = "firmata"
FIRST_ANALOG = 14  # the pin of A0 on an ATmega328P board
PINS = range(2, 20)  # of an ATmega328P board; 0 and 1 are the serial line, a Nano's A6 and A7 can only be read


def _on_the_board(pin: int) -> int:
    if pin not in PINS:
        raise ValueError("an ATmega328P board (Uno, Nano) has the pins 2 to 13, and A0 to A5, which are 14 to 19")
    return pin


Pin = Annotated[int, AfterValidator(_on_the_board)]


@dataclass(frozen=True, slots=True)
class Calibration:
    """Joint angle (rad) to pulse width (µs) and back, for one servo.

    `pulse` and `angle` are exact inverses on whole microseconds from `shortest` to `longest`, the pulses that this
    servo may get.
    """

    us_per_rad: float  # negative for a reversed servo
    zero_us: float  # the pulse of angle 0, which need not be reachable
    shortest: int
    longest: int
    lower: float = field(init=False)  # rad, the smallest reachable angle
    upper: float = field(init=False)  # rad, the largest

    def __post_init__(self) -> None:
        ends = self.angle(self.shortest), self.angle(self.longest)
        object.__setattr__(self, "lower", min(ends))
        object.__setattr__(self, "upper", max(ends))

    def pulse(self, angle: float) -> int:
        """Returns the whole pulse width (µs) nearest to a finite angle (rad), limited to the servo's pulses."""
        return round(min(max(self.zero_us + self.us_per_rad * angle, self.shortest), self.longest))

    def angle(self, pulse: float) -> float:
        """Returns the angle (rad) of a pulse width (µs); the pulse isn't limited here."""
        return (pulse - self.zero_us) / self.us_per_rad


class ServoConfig(BaseModel):
    """One joint: its pin and how pulse widths relate to angles."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pin: Pin = Field(description="the board's digital pin number, 2 to 19; A0 of an Uno is 14")
    min_us: int = Field(MIN_PULSE_US, ge=MIN_PULSE_US, le=MAX_PULSE_US, description="shortest pulse, us")
    max_us: int = Field(MAX_PULSE_US, ge=MIN_PULSE_US, le=MAX_PULSE_US, description="longest pulse, us")
    lower: float = Field(allow_inf_nan=False, description="rad, angle at min_us (at max_us if reversed)")
    upper: float = Field(allow_inf_nan=False, description="rad, angle at max_us (at min_us if reversed)")
    reversed: bool = Field(False, description="true where a longer pulse makes the angle smaller")
    home: float = Field(allow_inf_nan=False, description="rad, angle of the first command")
    trim_us: int = Field(0, ge=-400, le=400, description="added to every pulse, us; corrects the horn's seat")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.min_us >= self.max_us:
            raise ValueError(f"min_us ({self.min_us}) must be less than max_us ({self.max_us})")
        if self.lower >= self.upper:
            raise ValueError(
                f"lower ({self.lower:g}) must be less than upper ({self.upper:g}); "
                "'reversed: true' is for a servo that turns the other way"
            )
        reach = self.calibration
        if reach.shortest >= reach.longest:
            raise ValueError(f"trim_us ({self.trim_us}) leaves no pulses within 544 to 2400 us")
        if not reach.lower <= self.home <= reach.upper:
            raise ValueError(
                f"home ({self.home:g}) is outside the servo's reach, {reach.lower:.4g} to {reach.upper:.4g}"
            )
        return self

    @property
    def entry(self) -> Entry:
        """What a calibration rests on. `home` isn't in it: it is an angle of the joint."""
        return self.model_dump(exclude={"home"})

    @property
    def mirror(self) -> float:
        """rad: with `reversed` the other way round, the angle of a pulse is this less what it was."""
        return self.lower + self.upper

    @property
    def bounds(self) -> dict[str, float]:
        """None: `lower` and `upper` say what the pulses mean."""
        return {}

    def calibrated(self, line: Line) -> ServoConfig:
        """The servo as a calibration found it: other angles at the same pulses. Raises ValidationError."""
        lower, upper = (line.scale * (end - line.trim) for end in (self.lower, self.upper))
        turned = self.reversed != (line.direction < 0)
        return ServoConfig.model_validate(self.model_dump() | {"lower": lower, "upper": upper, "reversed": turned})

    @property
    def calibration(self) -> Calibration:
        """The conversion from angles to pulses.

        A trim that moves an end beyond 544 to 2400 µs reduces the reach by that amount: the board would read a value
        below 544 as an angle in degrees.
        """
        slope = (self.max_us - self.min_us) / (self.upper - self.lower)
        if self.reversed:
            slope = -slope
        at_min = self.upper if self.reversed else self.lower
        return Calibration(
            us_per_rad=slope,
            zero_us=self.min_us + self.trim_us - slope * at_min,
            shortest=max(self.min_us + self.trim_us, MIN_PULSE_US),
            longest=min(self.max_us + self.trim_us, MAX_PULSE_US),
        )


class ButtonConfig(BaseModel):
    """One push button between its pin and ground."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pin: Pin = Field(description="the board's digital pin number, 2 to 19; A0 of an Uno is 14")
    debounce: float = Field(0.02, ge=0, le=1, description="time a new level must last to count, s")
    pull_up: bool = Field(True, description="use the board's pull-up; false where a resistor to 5 V is wired")


class AnalogConfig(BaseModel):
    """One analog input. value = gain * share + offset, where share is 0 at 0 V and 1 at the board's supply."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    pin: int = Field(ge=FIRST_ANALOG, le=21, description="A0 is 14, A5 is 19; a Nano's A6 and A7 are 20 and 21")
    gain: float = Field(1.0, allow_inf_nan=False, description="in the unit, from 0 V to the supply")
    offset: float = Field(0.0, allow_inf_nan=False, description="in the unit, at 0 V")
    lower: float = Field(-1e12, allow_inf_nan=False, description="in the unit; a value below it is no sample")
    upper: float = Field(1e12, allow_inf_nan=False, description="in the unit; a value above it is no sample")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not self.lower < self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        if self.gain == 0.0:
            raise ValueError("gain: 0 would make every reading the same")
        return self


def once(pins: Iterable[tuple[str, int]]) -> None:
    """Raises ValueError: two of the named parts have the same pin."""
    taken: dict[int, str] = {}
    for name, pin in pins:
        if pin in taken:
            raise ValueError(f"pin {pin} is used twice, by {taken[pin]} and {name}")
        taken[pin] = name


class FirmataConfig(DeviceConfig):
    """A board with servos, buttons, analog inputs. The arrays have the order of `servos`, `buttons` and `analog`."""

    port: str = Field(description="the board's port, e.g. /dev/ttyACM0")
    servos: dict[str, ServoConfig] = Field(default={}, max_length=MAX_SERVOS, description="joints by name")
    buttons: dict[str, ButtonConfig] = Field(default={}, description="buttons by name")
    analog: dict[str, AnalogConfig] = Field(default={}, max_length=8, description="analog inputs by name")
    analog_unit: str = Field("1", min_length=1, description="SI, of the analog inputs; 1: the share of the supply")
    analog_interval: float = Field(0.01, ge=0.001, le=1.0, description="s between two readings of the analog inputs")
    calibration: ServoFile | None = Field(None, description="file of `srl calibrate PROFILE servos`")

    jointed: ClassVar[str] = "servos"  # where the entries of the joints are

    @property
    def joints(self) -> dict[str, ServoConfig]:
        """The servos by name, with what the calibration found.

        Raises ProfileError: the file can't be used, or a servo's home is out of its reach with it.
        """
        if self.calibration is None:
            return self.servos
        entries = {name: servo.entry for name, servo in self.servos.items()}
        found = dict(self.servos)
        for name, line in servo_record.lines(self.calibration, DRIVER, entries).items():
            try:
                found[name] = self.servos[name].calibrated(line)
            except ValidationError as error:
                place = f"{self.calibration.path}: joints.{name}"
                problem = f"with it, {refusal(error).problem}"
                raise ProfileError(place, problem, "Change `home` in the profile") from None
        return found

    @model_validator(mode="after")
    def _something_on_each_pin(self) -> Self:
        if not self.servos and not self.buttons and not self.analog:
            raise ValueError("the board has neither servos nor buttons nor analog inputs; name at least one")
        pins = [(name, servo.pin) for name, servo in self.servos.items()]
        pins += [(name, button.pin) for name, button in self.buttons.items()]
        pins += [(name, analog.pin) for name, analog in self.analog.items()]
        once(pins)
        return self
