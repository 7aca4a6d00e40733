"""What a force/torque sensor shows that nobody touches: its bias, and the weight of the tool that hangs on it.

A law takes it as its option `calibration`: in numbers, or as the file that `srl calibrate PROFILE ft` writes.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import ConfigDict, Discriminator, Field, FiniteFloat, Tag

from srl.control.cobot.axes import Point, Wrench
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.options import Options
from srl.runtime.models import record_file
from srl.runtime.models.record_file import Name

FORMAT: Final = "srl-ft-1"

_NotNegative = Annotated[FiniteFloat, Field(ge=0.0)]
_Six = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
_Three = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class Unloaded(Options):
    """The values, as a profile gives them."""

    bias: Wrench = Field((0.0,) * 6, description="N, N m: what the sensor shows without any load; subtracted first")
    tool_mass: float = Field(0.0, ge=0, description="kg, of what hangs on the sensor's measuring side (the handle)")
    tool_com: Point = Field((0.0, 0.0, 0.0), description="m, its centre of mass in the sensor's frame")


class FtRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        date: of the measurement.
        simulated: of a simulated sensor, so it says nothing about a real one.
        signal: the wrench that was measured, "sensor.wrench".
        frame: of the wrench; None where its device names none.
        poses: number of poses; of 1, the bias alone is known, and the tool's weight in that pose is part of it.
        bias: (6,) N, N m.
        tool_mass: kg; 0 of one pose.
        tool_com: (3,) m in the sensor's frame.
        left: N, N m: the most that is left in a pose.
        uncertain: standard deviations, N, N m, kg, m: of bias (force, torque), mass, centre.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-ft-1"]
    date: datetime.date
    simulated: bool
    signal: str
    frame: Name | None
    poses: Annotated[int, Field(ge=1, le=1000)]
    bias: _Six
    tool_mass: _NotNegative
    tool_com: _Three
    left: tuple[_NotNegative, _NotNegative]
    uncertain: tuple[_NotNegative, _NotNegative, _NotNegative, _NotNegative]


def _form(given: Any) -> str:
    """The form that was meant, so that an error is about that one."""
    return "tagged-values" if isinstance(given, Mapping | Unloaded) else "tagged-file"


_File = Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE ft`, or name another")]
FtCalibration = Annotated[
    Annotated[Unloaded, Tag("tagged-values")] | Annotated[_File, Tag("tagged-file")], Discriminator(_form)
]
"""The option's type: `{bias: ..., tool_mass: ..., tool_com: ...}`, or a file's path."""


def unloaded(given: Unloaded | KeptFile) -> tuple[Unloaded, FtRecord | None]:
    """The values of the option, and the file's record if it is one. Raises RecordError: the file can't be used."""
    if isinstance(given, Unloaded):
        return given, None
    made = record_file.parse(FtRecord, given.content, str(given.path))
    return Unloaded(bias=made.bias, tool_mass=made.tool_mass, tool_com=made.tool_com), made
