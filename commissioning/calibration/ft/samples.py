"""What the guided calibration of a force/torque sensor gave: wrenches with marks.

A mark is 0 where nothing counts, n while pose n is held, and 100 + n says that pose n is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.ft.fit import FtError, Thresholds
from srl.commissioning.calibration.held_still import LEFT_OUT, block_motion, held_poses
from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

MOST: Final = 30  # poses


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        wrench: (T, 6) N, N m in the sensor's frame; NaN where it wasn't measured.
        marks: (T,).
    """

    times: Array
    wrench: Array
    marks: Indices


class Plan(Options):
    """The poses, and how long the steps take."""

    poses: int = Field(8, ge=1, le=MOST, description="how many; 1 finds the bias alone")
    settle: float = Field(1.0, ge=0.2, description="s for which it must be still before a pose is taken")
    hold: float = Field(2.0, ge=0.5, description="s of a pose that count")


def steady(wrench: Array) -> float:
    """N: how far forces of wrenches (T, 6) have moved, as in `block_motion`; infinite where one isn't measured."""
    return block_motion(wrench[:, :3]) if np.isfinite(wrench).all() else float("inf")


def poses(samples: Samples, plan: Plan, thresholds: Thresholds) -> tuple[dict[int, Array], Array]:
    """The mean wrench (6,) of each pose that was held to its end and not left out; and the noise (6,).

    Raises FtError: none was, or one that counts wasn't still.
    """
    found: dict[int, Array] = {}
    spread = []
    for number, at in held_poses(samples, plan.poses, plan.hold).items():
        wrench = samples.wrench[at]
        if (moved := steady(wrench)) > thresholds.steady:
            problem = "some of its samples are missing" if moved == np.inf else f"the force changed by {moved:.2f} N"
            raise FtError(f"pose {number}", problem, "Do it again, still: r N, or --redo N --from FILE.rrd")
        found[number] = wrench.mean(axis=0)
        spread.append(wrench.std(axis=0) / np.sqrt(len(wrench)))
    if not found:
        raise FtError("poses", "none was held to its end", "Hold the sensor still in each")
    return found, np.sqrt(np.mean(np.square(spread), axis=0))


class FtMarksConfig(ControllerConfig):
    """Options of `ft-marks`."""

    signal: str = Field(description="the sensor's wrench")
    wrench: dict[str, str] = Field(description="where each of its axes is: fx: SIGNAL[ELEMENT]")
    plan: Plan = Plan()
    thresholds: Thresholds = Thresholds()


class FtMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = FtMarksConfig
    summary = "marks in the rows when a force/torque sensor is calibrated (srl calibrate PROFILE ft)"
    most = LEFT_OUT + MOST
