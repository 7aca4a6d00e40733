"""What the guided calibration of a frame gave: poses in the parent and in the frame, with marks.

A mark is 0 where nothing counts, n while point or pose n is held, and 100 + n says that it is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BeforeValidator, Field, FiniteFloat, model_validator
from scipy.spatial.transform import Rotation

from srl.commissioning.calibration.frames.exchanged import exchanged
from srl.commissioning.calibration.frames.fit import FEWEST, MountError, Thresholds
from srl.commissioning.calibration.held_still import LEFT_OUT, block_motion, held_poses
from srl.commissioning.calibration.marks import Indices, MarkedSamples, MarkLaw
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.rotation import Vector
from srl.runtime.contracts.signals import Array

MOST: Final = 30  # points or poses


@dataclass(frozen=True)
class Samples(MarkedSamples):
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        parent: (T, 7) m, w x y z: pose of what is seen in the parent; NaN where it wasn't measured.
        frame: (T, 7) the same in the frame; of known points, nothing that counts.
        marks: (T,).
    """

    times: Array
    parent: Array
    frame: Array
    marks: Indices


def _typed_vector(given: object) -> object:
    return given.split(",") if isinstance(given, str) else given


def _typed_points(given: object) -> object:
    return [point.split(",") for point in given.split(";") if point.strip()] if isinstance(given, str) else given


Typed = Annotated[Vector, BeforeValidator(_typed_vector)]
_Point = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class Plan(Options):
    """What is measured, and how long the steps take."""

    what: Literal["points", "poses"] = Field(
        "poses", description="points: a tip touches them; poses: two bodies that are fixed to each other"
    )
    count: int = Field(8, ge=4, le=MOST, description="how many")
    parent_tip: Typed = Field((0.0, 0.0, 0.0), description="m, x,y,z: the tip in what is seen in the parent; points")
    frame_tip: Typed = Field((0.0, 0.0, 0.0), description="m, x,y,z: the tip in what is seen in the frame; points")
    known: Annotated[tuple[_Point, ...], BeforeValidator(_typed_points)] = Field(
        (), description="m, x,y,z;x,y,z: the points' places in the frame, if nothing measures them there"
    )
    settle: float = Field(0.5, ge=0.2, description="s for which it must be still before it is taken")
    hold: float = Field(1.0, ge=0.5, description="s of it that count")

    @model_validator(mode="after")
    def _fits(self) -> Plan:
        if not all(map(np.isfinite, (*self.parent_tip, *self.frame_tip))):
            raise ValueError("a tip needs finite numbers")
        if self.known and self.what != "points":
            raise ValueError("known points go with what=points")
        if self.what == "poses" and any((*self.parent_tip, *self.frame_tip)):
            raise ValueError("a tip goes with what=points")
        if self.known and len(self.known) != self.count:
            raise ValueError(f"there are {len(self.known)} known points: write count={len(self.known)}, too")
        if self.count < FEWEST[self.what]:
            raise ValueError(f"{self.count} {self.what} don't find a frame: {FEWEST[self.what]} are needed")
        if self.known and (order := exchanged(np.array(self.known))):
            order_text = ", ".join(map(str, order))
            raise ValueError(
                f"touched in the order {order_text} the known points fit as well, and the frame is turned: "
                "take points whose distances differ by 20 mm"
            )
        return self

    def levers(self, thresholds: Thresholds) -> tuple[float, float]:
        """m: as what a rotation of 1 rad counts while one is held still, of what is seen in parent and frame."""
        if self.what == "poses":
            return thresholds.lever, thresholds.lever
        return float(np.linalg.norm(self.parent_tip)), 0.0 if self.known else float(np.linalg.norm(self.frame_tip))


def steady(poses: Array, lever: float) -> float:
    """m: how far poses (T, 7) have moved, as in `block_motion`; infinite where one isn't measured.

    Args:
        poses: (T, 7) m, w x y z.
        lever: m: a rotation of 1 rad counts as this.
    """
    if not np.isfinite(poses).all() or not len(poses):
        return float("inf")
    turns = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix().reshape(-1, 9)
    # Matrices differ by sqrt 2 times a small angle.
    return block_motion(np.hstack([poses[:, :3], lever / np.sqrt(2.0) * turns]))


def mean(poses: Array) -> Array:
    """(7,) m, w x y z: the mean of poses (T, 7)."""
    turn = Rotation.from_quat(poses[:, 3:], scalar_first=True).mean()
    return np.array([*poses[:, :3].mean(axis=0), *turn.as_quat(canonical=True, scalar_first=True)])


def held(samples: Samples, plan: Plan, thresholds: Thresholds) -> tuple[dict[int, tuple[Array, Array]], float]:
    """The mean poses (7,) in parent and frame of each that was held to its end and not left out; and the noise, m.

    Raises MountError: none was, or one that counts wasn't still.
    """
    found: dict[int, tuple[Array, Array]] = {}
    spread = []
    for number, at in held_poses(samples, plan.count, plan.hold).items():
        both = samples.parent[at], samples.frame[at]
        if (moved := max(map(steady, both, plan.levers(thresholds)))) > thresholds.steady:
            problem = "some of its samples are missing" if moved == np.inf else f"it moved by {1000 * moved:.1f} mm"
            place = f"{plan.what[:-1]} {number}"
            raise MountError(place, problem, "Do it again, still: r N, or --redo N --from FILE.rrd")
        found[number] = mean(both[0]), mean(both[1])
        spread += [poses[:, :3].std(axis=0).max() / np.sqrt(len(poses)) for poses in both]
    if not found:
        raise MountError(plan.what, "none was held to its end", "Hold still in each")
    return found, float(np.sqrt(np.mean(np.square(spread))))


def pairs(found: dict[int, tuple[Array, Array]], plan: Plan) -> tuple[tuple[int, ...], Array, Array]:
    """The numbers, and what is compared: (n, 3) m of points, (n, 7) of poses, in the parent and in the frame."""
    numbers = tuple(found)
    parent, frame = (np.array([found[n][k] for n in numbers]) for k in (0, 1))
    if plan.what == "poses":
        return numbers, parent, frame
    known = np.array([plan.known[n - 1] for n in numbers]) if plan.known else tip(frame, plan.frame_tip)
    return numbers, tip(parent, plan.parent_tip), known


def tip(poses: Array, offset: Vector) -> Array:
    """(n, 3) m: where a tip is that is `offset` (m) away from bodies (n, 7), in their axes."""
    turned: Array = Rotation.from_quat(poses[:, 3:], scalar_first=True).apply(offset)
    return poses[:, :3] + turned


class FrameMarksConfig(ControllerConfig):
    """Options of `frame-marks`."""

    frame: str = Field(description="the frame that is calibrated")
    parent: str = Field(description="its parent")
    drivers: dict[str, str] = Field(description="the devices that measured, and their drivers")
    serials: dict[str, str] = Field({}, description="the serial numbers of those whose entry demands one")
    parent_signal: str = Field(description="the pose that is measured in the parent")
    frame_signal: str | None = Field(None, description="the pose that is measured in the frame; null: known points")
    plan: Plan = Plan()
    thresholds: Thresholds = Thresholds()


class FrameMarks(MarkLaw):
    """See `MarkLaw`."""

    Config = FrameMarksConfig
    summary = "marks in the rows when a frame is calibrated (srl calibrate PROFILE frames)"
    most = LEFT_OUT + MOST
