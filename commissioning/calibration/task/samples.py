"""What the guided demonstration of a task gave: the hand's places, with marks.

A mark is 0 where nothing counts, 1 while the person stands still, 2 while the hand shows the task.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pydantic import Field

from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw
from srl.control.operation.options import IndependentOperationConfig
from srl.runtime.contracts.signals import Array
from srl.runtime.models.record_file import Name

STILL: Final = 1
SHOWN: Final = 2


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        hand: (T, 3) m in the frame of the arms' parent; NaN where it wasn't measured.
        marks: (T,).
    """

    times: Array
    hand: Array
    marks: Indices


class TaskMarksConfig(IndependentOperationConfig):
    """Options of `task-marks`: those of `independent-operation`, whose task is shown, and where the suit is."""

    person: Name = Field(description="anonymous id")
    rotation: dict[str, str] = Field(description="where each joint's rotation is: JOINT: SIGNAL[ELEMENT]")
    translation: dict[str, str] = Field(description="where each joint's translation is")


class TaskMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = TaskMarksConfig
    summary = "marks in the rows when the hand shows a task (srl calibrate PROFILE independent-operation)"
    most = SHOWN
