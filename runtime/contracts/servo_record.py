"""The file that `srl calibrate PROFILE servos` writes, and the drivers of servos read.

Of each joint it holds how the profile's own angle m, with the sense corrected, gives the joint's: q = scale (m - trim).
A driver puts that in place of what its entry says of the joint; the servo's own limits (pulses, counts) stay.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, Protocol

from pydantic import ConfigDict, Field, FiniteFloat, ValidationError, field_validator, model_validator

from srl.runtime.contracts.checksummed import HASH, ChangedError, opened
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.validation import refusal

FORMAT: Final = "srl-servos-1"
WHAT: Final = "servos"
"""What `srl calibrate PROFILE` calls it, and `Driver.calibrated`."""
TRIM: Final = 0.6
"""rad: two and a half teeth of a servo's horn (25 a turn). A greater trim is a wrong seat, or a wrong joint."""
SHARE: Final = 0.25
"""By which a scale may be off. Hobby servos of one type differ by some percent."""
AGAIN: Final = "Calibrate again: `srl calibrate PROFILE servos`"
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]
_NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]
Entry = dict[str, bool | int | float | str | None]
_LATER = ("offset", "reverse_mode")  # where an older file lacks one, it wasn't set


class Joint(Protocol):
    """A joint's entry in the profile, as its driver reads it."""

    @property
    def entry(self) -> Entry:
        """The options on which a calibration rests."""

    @property
    def mirror(self) -> float:
        """rad: with `reversed` the other way round, an angle is this less what it was."""

    @property
    def bounds(self) -> dict[str, float]:
        """rad, `lower` and `upper` of the joint, where these options are bounds and nothing else."""

    @property
    def home(self) -> float | None:
        """rad, of the joint."""


class Line(BaseModel):
    """One joint.

    Attributes:
        trim: rad, what the profile's angle is where the joint is at 0.
        direction: -1 where the joint turns the other way than the profile's entry says (`reversed`).
        scale: rad of the joint for a rad of the profile's angle.
        known: whether the scale was measured, by a second known angle; else it is 1.
        entry: the options of the profile on which these numbers rest.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    trim: FiniteFloat
    direction: Literal[-1, 1]
    scale: FiniteFloat
    known: bool
    entry: Entry

    @field_validator("trim")
    @classmethod
    def _is_a_trim(cls, value: float) -> float:
        if abs(value) > TRIM:
            raise ValueError(f"a trim of {value:.3g} rad is no servo's: {TRIM:g} rad at most")
        return value

    @field_validator("scale")
    @classmethod
    def _is_a_scale(cls, value: float) -> float:
        if abs(value - 1.0) > SHARE:
            raise ValueError(f"a scale of {value:.3g} is no servo's: it may be off by {SHARE:.0%} at most")
        return value


class ServoRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        by: who calibrated, an anonymous id; empty: not said.
        date: of the measurement.
        simulated: of simulated servos, so it says nothing about real ones.
        device, driver: whose servos, and of which driver.
        joints: by name.
        left: joints that weren't calibrated: the profile's entry stays.
        uncertain: rad, by which the commands were off while the joints were held, at most.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-servos-1"]
    by: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{0,32}$")]
    date: datetime.date
    simulated: bool
    device: _Name
    driver: _Name
    joints: Annotated[dict[_Name, Line], Field(min_length=1)]
    left: tuple[_Name, ...]
    uncertain: _NotNegative

    @model_validator(mode="after")
    def _each_once(self) -> ServoRecord:
        names = [*self.joints, *self.left]
        if twice := [name for i, name in enumerate(names) if name in names[:i]]:
            raise ValueError(f"'{twice[0]}' is named twice")
        return self


ServoFile = Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE servos`, or name an existing file")]
"""The type of a driver's option `calibration`."""


def read(file: KeptFile) -> ServoRecord:
    """What a file holds. Raises ProfileError: it was changed, is none, or its numbers can't be a servo's."""
    place = str(file.path)
    try:
        return ServoRecord.model_validate_json(json.dumps(opened(file.content)))
    except ChangedError as error:
        remedy = f'{AGAIN}; if you changed it on purpose, take "{HASH}" out'
        raise ProfileError(place, str(error), remedy) from None
    except ValidationError as error:
        first = refusal(error)
        raise ProfileError(first.at(place), first.problem, first.remedy_or(AGAIN)) from None
    except (ValueError, RecursionError) as error:
        problem = "it is nested too deeply" if isinstance(error, RecursionError) else f"it is no JSON: {error}"
        raise ProfileError(place, problem, AGAIN) from None


def lines(file: KeptFile, driver: str, joints: Mapping[str, Entry]) -> dict[str, Line]:
    """The calibrated joints of a file.

    Args:
        file: that a device names.
        driver: the device's.
        joints: the options of all its joints on which a calibration rests, by name.
    Raises:
        ProfileError: the file can't be used, is of another driver, of other joints, or of joints with other options.
    """
    made, place = read(file), str(file.path)
    if made.driver != driver:
        raise ProfileError(place, f"it is of servos of '{made.driver}', the device is a '{driver}'", AGAIN)
    for name in (*made.joints, *made.left):
        if name not in joints:
            problem = f"it is of another device: this one has no joint '{name}'"
            raise ProfileError(place, problem, nearest(name, joints))
    for name, entry in joints.items():
        if name in made.left:
            continue
        if name not in made.joints:
            raise ProfileError(place, f"it says nothing of the joint '{name}'", AGAIN)
        was = made.joints[name].entry
        for key in sorted(was.keys() | entry.keys()):
            if was.get(key) != entry.get(key) and (key not in _LATER or was.get(key) or entry.get(key)):
                before, now = _as_text(was.get(key)), _as_text(entry.get(key))
                problem = f"it was made with {key} {before}, the profile says {now}"
                raise ProfileError(f"{place}: joints.{name}", problem, f"Set it as it was, or {AGAIN.lower()}")
    return dict(made.joints)


def of_device(file: KeptFile | None, device: str) -> str:
    """The option whose file was made in simulation, for `Driver.simulated`; "" for none.

    Raises ProfileError: the file is of another device. Two alike can have joints of the same names.
    """
    if file is None:
        return ""
    made = read(file)
    if made.device != device:
        raise ProfileError(str(file.path), f"it is of the device '{made.device}', this one is '{device}'", AGAIN)
    return "calibration" if made.simulated else ""


def _as_text(value: Any) -> str:
    return "nothing" if value is None else str(value).lower() if isinstance(value, bool) else f"{value}"
