"""State as a dataclass of numbers, saved and restored as one row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Any


def flat(state: Any) -> list[float]:
    """All numbers of a dataclass whose fields are floats or tuples of floats, in their order."""
    out: list[float] = []
    for field in fields(state):
        value = getattr(state, field.name)
        if isinstance(value, tuple):
            out.extend(value)
        else:
            out.append(value)
    return out


def refill(state: Any, values: Iterator[float]) -> None:
    """Puts back what `flat` gave."""
    for field in fields(state):
        value = getattr(state, field.name)
        if isinstance(value, tuple):
            setattr(state, field.name, tuple(next(values) for _ in value))
        else:
            setattr(state, field.name, next(values))
