"""The marks of a calibration, by which each row says what the person was to do, and the law that holds them.

A mark is one number, so that it changes in one cycle: 0 nothing that counts, 1 static, 2 exploration, 3 the trial just
before doesn't count, 100 * point the point is left out and nothing of it before counts, and 100 * point + DoF in a
trial, both counted from 1. The mark is a parameter of the law `calibration-marks`, which has no other purpose: every
row holds it, and so does every recording. Where a trial was made again, the last one that counts is taken.
"""

from __future__ import annotations

from typing import Final

from pydantic import Field

from srl.commissioning.calibration.marks import MarkLaw
from srl.control.ikns.record import Name
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.controller import ControllerConfig

IDLE: Final = 0
STATIC: Final = 1
EXPLORATION: Final = 2
VOID: Final = 3
POINT: Final = 100


def mark_of(point: int, dof: int) -> int:
    """The mark of a trial; `point` and `dof` from 0 on."""
    return POINT * (point + 1) + dof + 1


def left_out(point: int) -> int:
    """The mark that leaves a point out, from 0 on."""
    return POINT * (point + 1)


def of_trial(mark: int) -> bool:
    """Whether it is a trial's."""
    return mark >= POINT and mark % POINT > 0


class MarksConfig(ControllerConfig):
    """Options of `calibration-marks`."""

    person: Name = Field(description="anonymous id")
    dofs: tuple[Name, ...] = Field(min_length=1, description="names of the degrees of freedom, in the marks' order")
    angles: dict[str, str] = Field(min_length=1, description="where each joint's angle is: JOINT: SIGNAL[ELEMENT]")
    held: dict[str, str] = Field(default_factory=dict, description="where it says that a joint isn't observed: 1")
    hand: str = Field(description="the signal of the hand's pose")
    thresholds: Thresholds = Field(default=Thresholds(), description="what is kept, and what is refused")


class Marks(MarkLaw):
    """See `MarkLaw`."""

    Config = MarksConfig
    summary = "marks in the rows of a calibration what the person was to do (srl calibrate)"

    def __init__(self, name: str, config: MarksConfig) -> None:
        self.most = mark_of(config.thresholds.points - 1, len(config.dofs) - 1)
        super().__init__(name, config)
