"""Samples with the mark of what a person was to do, and the law that marks each row of a calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.controller import Controller, ControllerConfig, Parameter
from srl.runtime.contracts.signals import Array

Indices = NDArray[np.intp]
IDLE: Final = 0  # the mark of what doesn't count


class MarkedSamples:
    """Samples of a run in the order of time. Those of a kind are a dataclass; what wasn't measured is NaN.

    Attributes:
        times: (T,) s.
        marks: (T,) what was to be done.
    """

    times: Array
    marks: Indices

    def __len__(self) -> int:
        return len(self.times)


S = TypeVar("S", bound=MarkedSamples)


def joined(parts: Sequence[S]) -> S:
    """Samples one after another; at least one part."""
    kind: Any = type(parts[0])
    found: S = kind(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(kind)))
    return found


def stretches(marks: Indices, mark: int) -> list[slice]:
    """All samples without a break that have this mark, among (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marks == mark, [False]]).astype(np.int8)))
    return [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def stretch_of(marks: Indices, mark: int) -> slice:
    """The last samples without a break that have this mark, among (T,); empty if there are none."""
    found = stretches(marks, mark)
    return found[-1] if found else slice(0, 0)


def ended(samples: S, counts: Callable[[int], bool]) -> S:
    """The samples of a whole recording, without the trial in which it stops; `counts`: whether a mark is a trial's."""
    marks = samples.marks.copy()
    if len(marks) and counts(int(marks[-1])):
        marks[stretch_of(marks, int(marks[-1]))] = IDLE
    made: Any = samples
    found: S = replace(made, marks=marks)
    return found


def held(samples: MarkedSamples, mark: int, hold: float) -> slice | None:
    """The last samples with this mark; None: there are none, or they are of less than nine tenths of `hold` s."""
    at = stretch_of(samples.marks, mark)
    if at.stop == at.start or samples.times[at][-1] - samples.times[at][0] < 0.9 * hold:
        return None
    return at


class MarkLaw(Controller):
    """Computes nothing. Its parameter `mark` says in every row what is to be done; its options, what is where.

    Attributes:
        most: the greatest mark.
    """

    most: int

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        most = float(self.most)
        self.parameters = (
            Parameter(name="mark", default=0.0, lower=0.0, upper=most, unit="1", text="what is to be done"),
        )

    def reset(self) -> None:
        """Nothing begins."""

    def update(self, dt: float) -> None:
        """Nothing is computed."""
