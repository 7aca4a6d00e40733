"""The file of a task that a person has shown: one JSON file, which a profile names as `task:`."""

from __future__ import annotations

import datetime
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field, FiniteFloat

from srl.control.operation.demonstration import LONGEST, PERIOD, TaskPath, Thresholds
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.models.record_file import Name

FORMAT = "srl-task-1"


class TaskRecord(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        person: an anonymous id.
        date: of the demonstration.
        simulated: by the simulated wearer.
        frame: the node in whose frame the points are.
        hand: the node that showed the task.
        thresholds: with which it was checked.
        points: m, 0.05 s apart.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-task-1"]
    person: Name
    date: datetime.date
    simulated: bool
    frame: Name
    hand: Name
    thresholds: Thresholds
    points: Annotated[
        tuple[tuple[FiniteFloat, FiniteFloat, FiniteFloat], ...],
        Field(min_length=2, max_length=round(LONGEST / PERIOD) + 1),
    ]

    @property
    def path(self) -> TaskPath:
        """The path."""
        return TaskPath(np.array(self.points))
