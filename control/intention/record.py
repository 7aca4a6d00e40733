"""The file of `intention`: one JSON file of the recogniser that was made from a person's own motion."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, FiniteFloat, NonNegativeInt, ValidationError, model_validator

from srl.control.intention.discriminant import Discriminant
from srl.control.intention.features import FEATURES, FRAMES, RATE
from srl.control.intention.training import BACKGROUND, Held, Recogniser, Thresholds
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.models import record_file
from srl.runtime.models.record_file import Name, RecordError, Row

FORMAT: Final = "srl-intention-1"
_LEAST: Final = 1e-6  # smallest eigenvalue of the covariance, by which its samples can be told from a broken file


class Class(BaseModel):
    """An action, or what isn't one. Names and units: `Discriminant`, `Triggers`; `taken_for`: `Held.confusion`.

    A file without `trigger` is older: its actions count within their whole limit.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    label: Name
    mean: Row
    limit: Annotated[FiniteFloat, Field(gt=0.0)]
    trigger: Annotated[FiniteFloat, Field(ge=0.0, le=1.0)] | None = None
    taken_for: tuple[NonNegativeInt, ...]


class Record(BaseModel):
    """What the file holds.

    Attributes:
        format: of the file.
        person: an anonymous id, or what people a recogniser of several was made from.
        date: of the recording.
        simulated: by simulated people, so it says nothing about people.
        rate, frames: Hz and number of the frames in a window.
        trunk: the trunk's joints, by which the suit's skeleton is told.
        thresholds: with which it was made.
        classes: actions, then the background.
        covariance: within the classes: rows of the lower triangle.
        temperature: as in `Discriminant`.
        held_out: share of the held-out windows that were taken for what they are.
        everyday: s of the wearer's everyday motion that triggers nothing.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["srl-intention-1"]
    person: Name
    date: datetime.date
    simulated: bool
    rate: FiniteFloat
    frames: int
    trunk: Annotated[tuple[Name, ...], Field(min_length=1)]
    thresholds: Thresholds
    classes: Annotated[tuple[Class, ...], Field(min_length=2)]
    covariance: tuple[Row, ...]
    temperature: Annotated[FiniteFloat, Field(gt=0.0)]
    held_out: FiniteFloat
    everyday: Annotated[FiniteFloat, Field(ge=0.0)] = 0.0

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if (self.rate, self.frames) != (RATE, FRAMES):
            raise ValueError(f"its windows are {self.frames} frames at {self.rate} Hz, here {FRAMES} at {RATE:g} Hz")
        if self.thresholds.dwell is None:
            raise ValueError("it doesn't say for how long an action must be seen (`dwell`)")
        triggers = {each.trigger is None for each in self.classes if each.label not in BACKGROUND}
        if len(triggers) > 1 or (self.everyday > 0.0 and True in triggers):
            raise ValueError("some actions don't say how near counts (`trigger`)")
        labels = [each.label for each in self.classes]
        if len(set(labels)) < len(labels) or len(self.actions) < 2:
            raise ValueError("it needs two actions, and each a name of its own")
        if labels[len(self.actions) :] != [label for label in BACKGROUND if label in labels]:
            raise ValueError("the actions come first, then the background")
        if any(len(each.mean) != FEATURES for each in self.classes):
            raise ValueError(f"each class must have a mean of {FEATURES} numbers")
        if [len(row) for row in self.covariance] != list(range(1, FEATURES + 1)):
            raise ValueError(f"the covariance must have {FEATURES} rows, each one number longer than the one before")
        if np.linalg.eigvalsh(self.discriminant().covariance)[0] < _LEAST:
            raise ValueError("the covariance isn't that of samples")
        return self

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the actions."""
        return tuple(each.label for each in self.classes if each.label not in BACKGROUND)

    @classmethod
    def of(
        cls, made: Recogniser, held: Held, thresholds: Thresholds, *, person: str, date: datetime.date,
        simulated: bool, trunk: Sequence[str],
    ) -> Record:  # fmt: skip
        """Returns the record of a recogniser. Raises RecordError: it isn't finite, or names don't fit."""
        found = made.discriminant
        classes = [
            {"label": label, "mean": mean.tolist(), "limit": float(limit), "taken_for": row.tolist()}
            for label, mean, limit, row in zip(made.labels, found.means, found.limits, held.confusion, strict=True)
        ]
        for row, trigger in zip(classes, made.triggers.limits.tolist(), strict=False):
            row["trigger"] = trigger
        values = {
            "format": FORMAT, "person": person, "date": date, "simulated": simulated, "rate": RATE, "frames": FRAMES,
            "trunk": tuple(trunk), "thresholds": thresholds.model_copy(update={"dwell": made.triggers.dwell}),
            "classes": classes, "everyday": made.triggers.everyday,
            "covariance": [row[: i + 1].tolist() for i, row in enumerate(found.covariance)],
            "temperature": found.temperature, "held_out": held.accuracy,
        }  # fmt: skip
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise record_file.refused("recogniser", error, "Record the actions again") from None

    def discriminant(self) -> Discriminant:
        """Returns the discriminant, as arrays."""
        covariance = np.zeros((FEATURES, FEATURES))
        for i, row in enumerate(self.covariance):
            covariance[i, : i + 1] = covariance[: i + 1, i] = row
        return Discriminant(
            np.array([each.mean for each in self.classes]), covariance,
            np.array([each.limit for each in self.classes]), self.temperature,
        )  # fmt: skip


def parse(content: bytes, place: str) -> Record:
    """Makes the record of a file's content; `place` names the file. Raises RecordError."""
    return record_file.parse(Record, content, place)


__all__ = ["FORMAT", "Class", "Record", "RecordError", "parse"]
