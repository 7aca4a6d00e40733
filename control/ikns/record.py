"""The calibration file of `ikns`: one JSON file a person and chain of joints."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from srl.control.ikns.calibration import Calibration
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.models import record_file
from srl.runtime.models.record_file import NAME, Name, RecordError, Row, write

__all__ = ["FORMAT", "NAME", "Name", "Point", "Record", "RecordError", "parse", "read", "write"]

FORMAT = "srl-ikns-1"

Count = Annotated[int, Field(ge=0, le=10**9)]
Share = Annotated[FiniteFloat, Field(ge=0.0, le=1.0 + 1e-9)]  # a sum of shares is rounded
Sine = Annotated[FiniteFloat, Field(ge=0.0, le=1.0)]
Cosine = Annotated[FiniteFloat, Field(ge=-1.0, le=1.0)]
Positive = Annotated[FiniteFloat, Field(ge=0.0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Point(_Part):
    """A calibration point. Names and units: `srl.control.ikns.calibration.Calibration`, one row of each array."""

    site: tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    directions: tuple[Row, ...]
    lower: Row
    upper: Row
    travel: tuple[Row, ...]
    samples: tuple[Count, ...]
    explained: tuple[Share, ...]
    wander: Positive
    condition: tuple[Sine, ...]
    crosstalk: tuple[tuple[Positive, ...], ...]
    agreement: Cosine


class Record(_Part):
    """What the file holds.

    Attributes:
        format: of the file.
        person: an anonymous id. No name: the file is copied beside recordings.
        date: of the recording.
        simulated: by the simulated wearer, so it says nothing about people.
        rate: Hz, of the recording.
        frame: in which `site` is, and in which the law expects the hand.
        joints: names of the angles, n.
        dofs: names of the degrees of freedom, k.
        thresholds: with which it was made.
        points: N.
        still, lost, jumps: of the recording, as in `Calibration`.
        bodies: by which the angles were measured, as the profile had them; empty in an older file.
    """

    format: Literal["srl-ikns-1"]
    person: Name
    date: datetime.date
    simulated: bool
    rate: Annotated[FiniteFloat, Field(gt=0.0)]
    frame: Name
    joints: Annotated[tuple[Name, ...], Field(min_length=1)]
    dofs: Annotated[tuple[Name, ...], Field(min_length=1)]
    thresholds: Thresholds
    points: Annotated[tuple[Point, ...], Field(min_length=4)]
    still: Share
    lost: Share
    jumps: Count
    bodies: dict[str, dict[str, Any]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _fits(self) -> Self:
        n, k = len(self.joints), len(self.dofs)
        for names in (self.joints, self.dofs):
            if len(set(names)) < len(names):
                raise ValueError("each joint and each degree of freedom needs a name of its own")
        for i, p in enumerate(self.points):
            rows = (p.lower, p.upper, p.samples, p.explained, p.condition)
            if any(len(row) != k for row in (*rows, p.directions, p.travel, p.crosstalk, *p.crosstalk)):
                raise ValueError(f"point {i + 1} must have {k} entries, one a degree of freedom")
            if any(len(row) != n for row in (*p.directions, *p.travel)):
                raise ValueError(f"point {i + 1} must have directions and travel of {n} numbers, one a joint")
            if any(low >= high for low, high in zip(p.lower, p.upper, strict=True)):
                raise ValueError(f"point {i + 1} has a lower end that isn't below its upper end")
        return self

    @classmethod
    def of(
        cls,
        found: Calibration,
        thresholds: Thresholds,
        *,
        person: str,
        date: datetime.date,
        simulated: bool,
        rate: float,
        frame: str,
        joints: Sequence[str],
        dofs: Sequence[str],
        bodies: Mapping[str, Any] | None = None,
    ) -> Record:
        """Returns the record of a calibration. Raises RecordError: it isn't finite, or names don't fit."""
        points = [
            {
                "site": found.sites[i].tolist(),
                "directions": found.directions[i].tolist(),
                "lower": found.lower[i].tolist(),
                "upper": found.upper[i].tolist(),
                "travel": found.travel[i].tolist(),
                "samples": found.samples[i].tolist(),
                "explained": found.explained[i].tolist(),
                "wander": float(found.wander[i]),
                "condition": found.condition[i].tolist(),
                "crosstalk": found.crosstalk[i].tolist(),
                "agreement": float(found.agreement[i]),
            }
            for i in range(len(found.sites))
        ]
        values = {
            "format": FORMAT, "person": person, "date": date, "simulated": simulated, "rate": rate, "frame": frame,
            "joints": tuple(joints), "dofs": tuple(dofs), "thresholds": thresholds, "points": points,
            "still": found.still, "lost": found.lost, "jumps": found.jumps,
            "bodies": dict(bodies or {}),
        }  # fmt: skip
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise record_file.refused("calibration", error, "Redo the points that `refusals` names") from None

    def calibration(self) -> Calibration:
        """Returns the calibration, as arrays."""
        a = {name: np.array([getattr(p, name) for p in self.points], dtype=float) for name in Point.model_fields}
        return Calibration(
            sites=a["site"], directions=a["directions"], lower=a["lower"], upper=a["upper"],
            travel=a["travel"], samples=a["samples"].astype(np.intp), explained=a["explained"], wander=a["wander"],
            condition=a["condition"], crosstalk=a["crosstalk"], agreement=a["agreement"],
            still=self.still, lost=self.lost, jumps=self.jumps,
        )  # fmt: skip


def read(path: Path) -> Record:
    """Reads a calibration file. Raises RecordError."""
    return record_file.read(Record, path)


def parse(content: bytes, place: str) -> Record:
    """Makes the record of a calibration file's content; `place` names the file. Raises RecordError."""
    return record_file.parse(Record, content, place)
