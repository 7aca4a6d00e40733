"""The marks of a calibration of `intention`, by which each row says what the person was to do, and their law.

A mark is one number, so that it changes in one cycle: 0 nothing that counts; 1 the trial just before doesn't count;
100 * round + number in a trial, both from 1 on. The numbers are those of the actions in their order, then EVERYDAY,
STAND and WALK. It is a parameter of the law `intention-marks`. Where a trial was made again, the last one that counts
is taken.
"""

from __future__ import annotations

from typing import Final

from pydantic import Field

from srl.commissioning.calibration.marks import MarkLaw
from srl.control.intention.training import Thresholds
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.models.record_file import Name

IDLE: Final = 0
VOID: Final = 1
MOST_ROUNDS: Final = 50
EVERYDAY: Final = 97
STAND: Final = 98
WALK: Final = 99
ROUND: Final = 100


def mark_of(turn: int, number: int) -> int:
    """The mark of a trial in a round, from 0 on; `number`: EVERYDAY, STAND, WALK, or an action's number, from 0 on."""
    return ROUND * (turn + 1) + (number if number >= EVERYDAY else number + 1)


class IntentionMarksConfig(ControllerConfig):
    """Options of `intention-marks`."""

    person: Name = Field(description="anonymous id")
    actions: tuple[Name, ...] = Field(min_length=2, max_length=90, description="their names, in the marks' order")
    trunk: tuple[Name, ...] = Field(min_length=1, description="joints of the trunk")
    rotation: dict[str, str] = Field(description="where each joint's rotation is: JOINT: SIGNAL[ELEMENT]")
    translation: dict[str, str] = Field(description="where each joint's translation is")
    thresholds: Thresholds = Field(default=Thresholds(), description="what is kept, and what is refused")


class IntentionMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = IntentionMarksConfig
    summary = "marks in the rows what actions the person was to do (srl calibrate PROFILE intention)"
    most = mark_of(MOST_ROUNDS, WALK)
