"""The error for invalid study data, and the checks that several modules share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array


class StudyError(SrlError):
    """A study can't be evaluated: data are missing, out of range or don't pair, or a result can't be written."""


def numbers(place: str, values: ArrayLike, least: int = 1) -> Array:
    """Returns the values as (n,) float64.

    Raises:
        StudyError: fewer than `least`, not one row of numbers, or one of them isn't finite.
    """
    try:
        found = np.asarray(values, float)
    except (TypeError, ValueError):
        raise StudyError(place, "expected numbers", "Leave out what isn't one") from None
    if found.ndim != 1:
        raise StudyError(place, f"expected one row of numbers, got the shape {found.shape}", "Give one value a subject")
    if len(found) < least:
        raise StudyError(place, f"expected at least {least} values, got {len(found)}", "Add the missing ones")
    if not np.isfinite(found).all():
        at = int(np.argmin(np.isfinite(found)))
        raise StudyError(
            place, f"value {at + 1} of {len(found)} is {found[at]}", "Leave the subject out of both conditions"
        )
    return found


def pairs(place: str, first: ArrayLike, second: ArrayLike, least: int = 1) -> tuple[Array, Array]:
    """Returns two rows of numbers, the same subject at the same index.

    Raises:
        StudyError: as in `numbers`, or one row is longer.
    """
    one, other = numbers(place, first, least), numbers(place, second, least)
    if len(one) != len(other):
        problem = f"{len(one)} values don't pair with {len(other)}"
        raise StudyError(place, problem, "Give one value of each condition for each subject, in the same order")
    return one, other


def exactly(place: str, given: Iterable[str], expected: Sequence[str], what: str) -> None:
    """Checks that these names are given, each once, in any order.

    Raises:
        StudyError: one is missing, unknown or given twice.
    """
    names = list(given)
    remedy = f"The {what}s are {', '.join(expected)}"
    for name in names:
        if name not in expected:
            raise StudyError(place, f"there is no {what} '{name}'", remedy)
        if names.count(name) > 1:
            raise StudyError(place, f"the {what} '{name}' is there twice", "Keep one of them")
    if missing := [name for name in expected if name not in names]:
        raise StudyError(place, f"without the {what} {', '.join(missing)}", remedy)
