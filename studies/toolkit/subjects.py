"""Simulated subjects of a study: drawn once from distributions in a yaml file, listed in a csv file before any run."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from ruamel.yaml import YAML

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Subject = TypeVar("Subject", bound="DataclassInstance")


def assumed(yaml: Path) -> Mapping[str, Any]:
    """The distributions and constants of a file, by name. Each entry has `value`, and its source beside it."""
    sections = YAML(typ="safe", pure=True).load(yaml)
    return {name: entry["value"] for name, entry in sections.items()}


def quantity(entry: Mapping[str, float], z: float) -> float:
    """What somebody has whose standard normal deviate is z.

    Args:
        entry: `median` and `spread` (of the logarithm), or `mean` and `deviation`, or `low` and `high` (all alike
            probable); `least` and `most` cut it.
        z: standard normal.
    """
    if "low" in entry:
        found = entry["low"] + (entry["high"] - entry["low"]) * NormalDist().cdf(z)
    elif "median" in entry:
        found = entry["median"] * np.exp(entry["spread"] * z)
    else:
        found = entry["mean"] + entry["deviation"] * z
    return float(np.clip(found, entry.get("least", -np.inf), entry.get("most", np.inf)))


def listed(path: Path, kind: Callable[..., Subject], count: int) -> list[Subject]:
    """Reads the first `count` subjects of a csv file, whose column `name` is text, and all others numbers."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [kind(row.pop("name"), **{name: float(value) for name, value in row.items()}) for row in rows[:count]]


def write(path: Path, subjects: Sequence[Subject]) -> None:
    """Writes such a file."""
    names = [field.name for field in fields(subjects[0])]
    with path.open("w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(names)
        out.writerows([getattr(one, name) for name in names] for one in subjects)
