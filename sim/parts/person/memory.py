"""Saves and restores a dataclass of numbers as one row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any


def flat(state: Any) -> list[float]:
    """Returns all numbers of a dataclass whose fields are floats or tuples of floats, in order."""
    out: list[float] = []
    for field in fields(state):
        value = getattr(state, field.name)
        if isinstance(value, tuple):
            out.extend(value)
        else:
            out.append(value)
    return out


def refill(state: Any, values: Iterator[float]) -> None:
    """Restores the values returned by `flat`."""
    for field in fields(state):
        value = getattr(state, field.name)
        if isinstance(value, tuple):
            setattr(state, field.name, tuple(next(values) for _ in value))
        else:
            setattr(state, field.name, next(values))
