"""What the guided calibration of a suit gave: its segments' rotations with marks.

A mark is 0 where nothing counts, and n while the person stands for the n-th time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw, held
from srl.commissioning.calibration.suit.fit import Stands, Thresholds
from srl.commissioning.calibration.suit.segments import SuitError, in_world, mean
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

MOST: Final = 30  # stands
_BLOCKS: Final = 5


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        rotation: (T, n, 4) w x y z of each segment in its parent; NaN where it wasn't measured.
        marks: (T,).
    """

    times: Array
    rotation: Array
    marks: Indices


class Plan(Options):
    """How often and how long."""

    device: str = Field("", description="the suit; needed where the profile has several")
    pose: Literal["n", "t"] = Field("n", description="how the person stands: n, arms down; t, arms out")
    stands: int = Field(5, ge=3, le=MOST, description="how often the person stands")
    walk: float = Field(40.0, ge=2.0, le=1800, description="s of walking and turning between two")
    read: float = Field(4.0, ge=0.5, le=60, description="s for which the person must be still before the first counts")
    settle: float = Field(1.5, ge=0.5, le=30, description="s of the same before each other")
    hold: float = Field(8.0, ge=2.0, le=60, description="s of a stand that count: a person sways")


def moved(turned: Array) -> float:
    """rad: how far the means of consecutive blocks are apart at most, in any segment; infinite where one is missing.

    Args:
        turned: (T, n, 4) w x y z in the world.
    """
    if len(turned) < _BLOCKS or not np.isfinite(turned).all():
        return float("inf")
    means = np.array([mean(part) for part in np.array_split(turned, _BLOCKS)])
    cosine = np.abs(np.einsum("ink,jnk->ijn", means, means))
    return float(2.0 * np.arccos(np.clip(cosine, 0.0, 1.0)).max())


def stands(samples: Samples, parents: Sequence[int], plan: Plan, thresholds: Thresholds) -> Stands:
    """What the person's stands gave.

    Raises:
        SuitError: one isn't there, wasn't held still to its end, or the suit never moved.
    """
    times, turned = [], []
    for number in range(1, plan.stands + 1):
        at, place = held(samples, number, plan.hold), f"stand {number}"
        if at is None:
            raise SuitError(place, "it wasn't held to its end", "Begin anew: a drift needs one session without a break")
        part = in_world(samples.rotation[at], parents)
        if (by := moved(part)) > thresholds.still:
            problem = (
                "some samples are missing" if np.isinf(by) else f"the person moved by {np.degrees(by):.0f} degrees"
            )
            raise SuitError(place, problem, f"Stand still: r {number}, or begin anew")
        times.append(float(samples.times[at].mean()))
        turned.append(mean(part))
    seen = samples.rotation[np.isfinite(samples.rotation).all(axis=(1, 2))]
    return Stands(np.array(times), np.array(turned), _own_motion(seen))


def _own_motion(rotation: Array) -> Array:
    """(n,) rad: how far each segment turns in its parent, at most, from where it was at first."""
    cosine = np.abs(np.einsum("tnk,nk->tn", rotation, rotation[0]))
    found: Array = (2.0 * np.arccos(np.clip(cosine, 0.0, 1.0))).max(axis=0)
    return found


class SuitMarksConfig(ControllerConfig):
    """Options of `suit-marks`."""

    person: str = Field(description="anonymous id")
    signal: str = Field(description="the suit's rotations")
    segments: tuple[str, ...] = Field(min_length=1, description="their names, as they are among its elements")
    parents: tuple[int, ...] = Field(min_length=1, description="each one's parent among them; -1: none")
    plan: Plan = Plan()
    thresholds: Thresholds = Thresholds()


class SuitMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = SuitMarksConfig
    summary = "marks in the rows when a capture suit is calibrated (srl calibrate PROFILE suit)"
    most = MOST
