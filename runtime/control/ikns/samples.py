"""What a calibration's run gave, sample by sample, with marks that say what the person was to do.

A mark is one number, so that it changes in one cycle: 0 nothing that counts, 1 static, 2 exploration, 3 the trial just
before doesn't count, 100 * point the point is left out and nothing of it before counts, and 100 * point + DoF in a
trial, both counted from 1. The mark is a parameter of the law `calibration-marks`, which has no other purpose: every
row holds it, and so does every recording. Where a trial was made again, the last one that counts is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydantic import Field

from runtime.contracts.controller import Controller, ControllerConfig, Parameter
from runtime.contracts.signals import Array
from runtime.control.ikns.calibration import CalibrationError, Recording, Thresholds
from runtime.control.ikns.clusters import Indices
from runtime.control.ikns.record import Name

IDLE: Final = 0
STATIC: Final = 1
EXPLORATION: Final = 2
VOID: Final = 3
LEAST_POINTS: Final = 8  # a box's corners
_POINT: Final = 100
_GAP: Final = 1.0  # s, between the samples of two recordings


def mark_of(point: int, dof: int) -> int:
    """The mark of a trial; `point` and `dof` from 0 on."""
    return _POINT * (point + 1) + dof + 1


def left_out(point: int) -> int:
    """The mark that leaves a point out, from 0 on."""
    return _POINT * (point + 1)


@dataclass(frozen=True)
class Samples:
    """Samples in the order of time.

    Attributes:
        times: (T,) s.
        angles: (T, n) rad; not finite where a joint wasn't observed.
        hand: (T, 3) m; not finite where it wasn't.
        marks: (T,).
    """

    times: Array
    angles: Array
    hand: Array
    marks: Indices

    def __len__(self) -> int:
        return len(self.times)


def joined(parts: Sequence[Samples]) -> Samples:
    """Samples one after another; the times of one that doesn't follow on are moved behind those before."""
    times: list[Array] = []
    end = -np.inf
    for part in parts:
        if not len(part):
            continue
        shift = 0.0 if part.times[0] > end else end + _GAP - part.times[0]
        times.append(part.times + shift)
        end = times[-1][-1]
    some = [part for part in parts if len(part)] or list(parts[:1])
    # In C order, whatever the parts' was: sums in another order would differ in the last bit.
    return Samples(
        np.concatenate(times) if times else np.empty(0), np.ascontiguousarray(np.concatenate([p.angles for p in some])),
        np.ascontiguousarray(np.concatenate([p.hand for p in some])), np.concatenate([p.marks for p in some]),
    )  # fmt: skip


def stretch(samples: Samples, mark: int) -> slice:
    """The last samples without a break that have this mark; empty if there are none."""
    found = np.flatnonzero(samples.marks == mark)
    if not len(found):
        return slice(0, 0)
    breaks = np.flatnonzero(np.diff(found) > 1)
    return slice(int(found[breaks[-1] + 1 if len(breaks) else 0]), int(found[-1]) + 1)


def ended(samples: Samples) -> Samples:
    """The samples of a whole recording: a trial in which it ended was broken off, so it doesn't count."""
    marks = samples.marks.copy()
    if len(marks) and _of_trial(int(marks[-1])):
        marks[stretch(samples, int(marks[-1]))] = IDLE
    return replace(samples, marks=marks)


def _of_trial(mark: int) -> bool:
    return mark >= _POINT and mark % _POINT > 0


def _counting(samples: Samples) -> Samples:
    """The samples with nothing to count in the trials that were broken off and at the points that were left out."""
    marks = samples.marks.copy()
    begins = np.flatnonzero(np.diff(marks, prepend=-1))
    for before, begin in zip((0, *begins), begins, strict=False):
        mark = int(marks[begin])
        if mark == VOID:
            marks[before:begin] = IDLE
        elif mark >= _POINT and not _of_trial(mark):
            earlier = marks[:begin]
            earlier[earlier // _POINT == mark // _POINT] = IDLE
    return replace(samples, marks=marks)


def seen(samples: Samples, at: slice) -> Array:
    """(T, 3) m: the hand's positions of those of the samples that have angles and hand."""
    whole = np.isfinite(np.column_stack([samples.angles[at], samples.hand[at]])).all(axis=1)
    found: Array = samples.hand[at][whole]
    return found


def trials(samples: Samples, dofs: int) -> tuple[Recording, tuple[int, ...]]:
    """Returns the samples of the trials, and the number (from 1) by which the person knows each point.

    A point without a trial of each DoF is left out. Raises CalibrationError: too few points are left.
    """
    samples = _counting(samples)
    points = sorted({int(mark) // _POINT for mark in np.unique(samples.marks) if mark >= _POINT})
    cuts: list[tuple[slice, int, int]] = []
    numbers: list[int] = []
    for number in points:
        own = [stretch(samples, mark_of(number - 1, j)) for j in range(dofs)]
        if all(s.stop > s.start for s in own):
            cuts += [(s, len(numbers), j) for j, s in enumerate(own)]
            numbers.append(number)
    if len(numbers) < LEAST_POINTS:
        raise CalibrationError(
            "points", f"{len(numbers)} points have a trial of each DoF, {LEAST_POINTS} are needed",
            "Do the other points, too",
        )  # fmt: skip
    for at, i, _ in cuts:
        if not len(seen(samples, at)):
            raise CalibrationError(
                f"point {numbers[i]}", "no sample of its trial has angles and hand: markers were missing",
                "See that every marker is seen there, and redo the point",
            )  # fmt: skip
    cuts.sort(key=lambda cut: cut[0].start)
    take = np.concatenate([np.arange(s.start, s.stop) for s, _, _ in cuts])
    each = lambda k: np.concatenate([np.full(c[0].stop - c[0].start, c[k], np.intp) for c in cuts])  # noqa: E731
    found = Recording(samples.times[take], samples.angles[take], samples.hand[take], each(2), each(1))
    return found, tuple(numbers)


def whole(samples: Samples) -> Recording:
    """All samples of a recording without marks, for one DoF: its points are found by clusters alone."""
    return Recording(samples.times, samples.angles, samples.hand, np.zeros(len(samples), np.intp))


class MarksConfig(ControllerConfig):
    """Options of `calibration-marks`."""

    person: Name = Field(description="anonymous id")
    dofs: tuple[Name, ...] = Field(min_length=1, description="names of the degrees of freedom, in the marks' order")
    angles: dict[str, str] = Field(min_length=1, description="where each joint's angle is: JOINT: SIGNAL[ELEMENT]")
    held: dict[str, str] = Field(default_factory=dict, description="where it says that a joint isn't observed: 1")
    hand: str = Field(description="the signal of the hand's pose")
    thresholds: Thresholds = Field(default=Thresholds(), description="what is kept, and what is refused")


class Marks(Controller):
    """Computes nothing. It says in every row what the person was to do, and where the calibration's signals are."""

    Config = MarksConfig
    summary = "marks in the rows of a calibration what the person was to do (srl calibrate)"

    def __init__(self, name: str, config: MarksConfig) -> None:
        super().__init__(name, config)
        most = float(mark_of(config.thresholds.points - 1, len(config.dofs) - 1))
        self.parameters = (
            Parameter(name="mark", default=0.0, lower=0.0, upper=most, unit="1", text="what the person is to do"),
        )

    def reset(self) -> None:
        """Nothing begins."""

    def update(self, dt: float) -> None:
        """Nothing is computed."""
