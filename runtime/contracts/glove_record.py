"""The file that `srl calibrate PROFILE glove` writes, and a glove's driver reads."""

from __future__ import annotations

import datetime
from typing import Annotated, Final, Literal

from pydantic import ConfigDict, Field, FiniteFloat, field_validator, model_validator

from srl.runtime.contracts.entry import BaseModel

FORMAT: Final = "srl-glove-1"
_NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]


class Line(BaseModel):
    """One sensor's characteristic: rad = gain (count - offset).

    Attributes:
        gain: rad a count, 0.0001 to 1, of either sign.
        offset: count of the flat hand, 1 to 255.
        noise: counts, standard deviation while the hand was held still.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    gain: FiniteFloat
    offset: Annotated[FiniteFloat, Field(ge=1.0, le=255.0)]
    noise: _NotNegative

    @field_validator("gain")
    @classmethod
    def _is_a_slope(cls, value: float) -> float:
        if not 1e-4 <= abs(value) <= 1.0:
            raise ValueError("gain must be 0.0001 to 1 rad a count, of either sign")
        return value


class GloveRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        person: anonymous id.
        date: of the measurement.
        hand: whose glove it is.
        simulated: of a simulated glove, so it says nothing about a real one.
        signal: what was measured, "glove.raw".
        sensors: of each sensor that was calibrated.
        average: sensors that weren't: an average hand's characteristic stays.
        uncertain: rad, the greatest standard deviation of an angle by noise and rounding.
        again: rad, by which the flat hand at the end differed at most from that of the beginning.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-glove-1"]
    person: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
    date: datetime.date
    hand: Literal["right", "left"]
    simulated: bool
    signal: str
    sensors: Annotated[dict[str, Line], Field(min_length=1)]
    average: tuple[str, ...]
    uncertain: _NotNegative
    again: _NotNegative

    @model_validator(mode="after")
    def _each_once(self) -> GloveRecord:
        names = [*self.sensors, *self.average]
        if twice := [name for i, name in enumerate(names) if name in names[:i]]:
            raise ValueError(f"'{twice[0]}' is named twice")
        return self
