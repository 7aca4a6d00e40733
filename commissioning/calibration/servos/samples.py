"""What the guided calibration of servos gave: the joints' angles, as the profile's entry has them, with marks.

A mark is 0 where nothing counts, 100 + n while joint n is held at its first angle, 200 + n at its second, and 300 + n
says that joint n is left out. Joints count from 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field, model_validator

from srl.commissioning.calibration import marks
from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw
from srl.commissioning.calibration.servos.fit import ServoError, Thresholds
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.servo_record import Entry
from srl.runtime.contracts.signals import Array

FIRST: Final = 100
SECOND: Final = 200
LEFT_OUT: Final = 300
MOST: Final = 99  # joints


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        angles: (T, n) rad, of all joints: measured where the servo measures, else as sent. NaN where not known.
        marks: (T,).
    """

    times: Array
    angles: Array
    marks: Indices


class Plan(Options):
    """Which joints, at which angles, and how long the steps take."""

    device: str = Field("", description="whose servos; needed where several devices could be meant")
    by: str = Field("", pattern=r"^[A-Za-z0-9_-]{0,32}$", description="who calibrates, an anonymous id")
    first: str = Field("0", description="rad, each joint's first angle: `0`, or `knuckle:0.1,tip:-0.2` (others: 0)")
    second: str = Field("", description="rad, known second angles: `0.785`, or `knuckle:0.785`; none: only the sense")
    speed: float = Field(0.1, gt=0, le=0.5, description="rad/s, of a held key; `,` and `.` are a fifth of it")
    settle: float = Field(0.5, ge=0.2, description="s after Enter before an angle is taken")
    hold: float = Field(1.0, ge=0.3, description="s of an angle that count")


def angles(text: str, joints: Sequence[str], option: str) -> dict[str, float]:
    """Angles by joint, rad: of all joints (`0.785`), or of those that are named (`knuckle:0.785,tip:-0.2`).

    Raises ServoError: a text is no angle within a turn, or names no joint.
    """
    found: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, colon, value = part.rpartition(":")
        try:
            angle = float(value)
        except ValueError:
            angle = np.nan
        if not abs(angle) <= 2 * np.pi:
            raise ServoError(f"--option {option}", f"'{part}' is no angle in rad", "Write knuckle:0.785,tip:-0.2")
        if colon and name not in joints:
            remedy = f"Its joints are {', '.join(joints)}"
            raise ServoError(f"--option {option}", f"the device has no joint '{name}'", remedy)
        found |= {name: angle} if colon else dict.fromkeys(joints, angle)
    return found


def held(samples: Samples, joint: int, second: bool, plan: Plan, thresholds: Thresholds) -> tuple[float, float] | None:
    """The mean of a joint's angle, and its standard deviation, rad; None: it wasn't held to the end.

    `joint` counts from 0. Raises ServoError: it moved meanwhile, or samples are missing.
    """
    at = marks.held(samples, (SECOND if second else FIRST) + joint + 1, plan.hold)
    if at is None:
        return None
    angle = samples.angles[at, joint]
    moved = float(np.ptp(angle)) if np.isfinite(angle).all() else np.inf
    if moved > thresholds.steady:
        problem = "some of its samples are missing" if moved == np.inf else f"it moved by {moved:.3f} rad while held"
        raise ServoError(f"joint {joint + 1}", problem, "Do it again: r N, or --redo N --from FILE.rrd")
    return float(angle.mean()), float(angle.std())


def left_out(samples: Samples, joint: int) -> bool:
    """Whether the newest word on a joint (from 0 on) is that it is left out."""
    out = np.flatnonzero(samples.marks == LEFT_OUT + joint + 1)
    done = np.flatnonzero(np.isin(samples.marks, (FIRST + joint + 1, SECOND + joint + 1)))
    return bool(len(out)) and (not len(done) or out[-1] > done[-1])


class ServoMarksConfig(ControllerConfig):
    """Options of `servo-marks`: what was calibrated, so that a recording says it all."""

    device: str
    driver: str
    signal: str = Field(description="the angles: measured, or as sent")
    joints: dict[str, Entry] = Field(min_length=1, max_length=MOST, description="the entries' options, by joint")
    mirror: list[float] = Field(description="rad, by joint: turned round, an angle is this less what it was")
    home: list[float] | None = Field(description="rad, of the joints; none: the servos measure where they are")
    lower: list[float] = Field(description="rad, which the servos reach in the entries' angles")
    upper: list[float]
    measures: bool = Field(description="whether the servos measure: then their scale is theirs")
    plan: Plan = Plan()
    thresholds: Thresholds = Thresholds()

    @model_validator(mode="after")
    def _fits(self) -> ServoMarksConfig:
        if {len(self.joints)} != {len(each) for each in (self.mirror, self.lower, self.upper)}:
            raise ValueError("one number for each joint")
        return self


class ServoMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = ServoMarksConfig
    summary = "marks in the rows when servos are calibrated (srl calibrate PROFILE servos)"
    most = LEFT_OUT + MOST
