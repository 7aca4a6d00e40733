"""The file that `srl calibrate PROFILE suit` writes, and a suit's driver reads."""

from __future__ import annotations

import datetime
from typing import Annotated, Final, Literal

from pydantic import ConfigDict, Field, FiniteFloat

from srl.runtime.contracts.entry import BaseModel

FORMAT: Final = "srl-suit-1"
_NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]
_Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]


class Drift(BaseModel):
    """How fast a segment turned about the vertical, on the average of the calibration.

    Attributes:
        rate: rad/s, positive to the left (about the suit's y, up).
        uncertain: rad/s, standard deviation, from how the stands scatter about the line.
        measured: whether the segment moves by itself; else it has no sensor, and turns with its parent.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    rate: FiniteFloat
    uncertain: _NotNegative
    measured: bool


class SuitRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        person: anonymous id.
        date: of the measurement. It holds until the suit is calibrated in its own program again, or taken off.
        simulated: of a simulated suit, so it says nothing about a real one.
        signal: what was measured, "suit.rotation".
        pose: in which the person stood: "n", arms down, or "t".
        heading: rad, -pi to pi, at the end: how far the person, who faced the stated direction, seemed to be turned to
            the left (about the suit's y, up) from the z axis of the suit's world. The driver takes it back.
        uncertain: rad, its standard deviation, from how the stands scatter.
        stands: number of times that the person stood.
        seconds: from the first to the last.
        drifts: by segment. Nothing corrects them.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-suit-1"]
    person: _Name
    date: datetime.date
    simulated: bool
    signal: str
    pose: Literal["n", "t"]
    heading: Annotated[FiniteFloat, Field(ge=-3.1416, le=3.1416)]
    uncertain: _NotNegative
    stands: Annotated[int, Field(ge=3, le=100)]
    seconds: Annotated[FiniteFloat, Field(gt=0.0)]
    drifts: Annotated[dict[_Name, Drift], Field(min_length=1)]
