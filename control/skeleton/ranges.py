"""The limits of a worn arm's joints, as options of laws."""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.per_element import Finite, Positive, in_order
from srl.runtime.contracts.signals import Array


class JointRanges:
    """The joints' limits, and the posture that the arm goes to where it may. Arrays (n,), rad or m, and s."""

    def __init__(
        self, lower: Array, upper: Array, speed: Array, acceleration: Array, posture: Array | None = None
    ) -> None:
        """`posture`: rad or m; None: the middle of the ranges."""
        self.n = len(lower)
        self.posture = 0.5 * (lower + upper) if posture is None else posture
        self.q_lower, self.q_upper, self.dq_max, self.ddq_max = lower, upper, speed, acceleration


class RangeOptions(EnvelopeOptions):
    """The limits of each joint."""

    lower: dict[str, Finite] = Field(description="rad or m, of each joint")
    upper: dict[str, Finite] = Field(description="rad or m, of each joint")
    velocity: dict[str, Positive] = Field(description="rad/s or m/s, of each joint; the guard's or less")
    acceleration: dict[str, Positive] = Field(description="rad/s^2 or m/s^2, of each joint; the guard's or less")

    @cached_property
    def ranges(self) -> JointRanges:
        """The joints' limits in the arm's order. Raises OptionError."""
        labels = self.arms.arms.labels
        values: list[Array] = []
        for key in ("lower", "upper", "velocity", "acceleration", "posture"):
            if getattr(self, key, None) is None:
                continue
            try:
                values.append(np.array(in_order(getattr(self, key), labels), dtype=float))
            except OptionError as error:
                raise OptionError(f"{key}: {error.problem}", error.remedy) from None
        return JointRanges(*values)

    @model_validator(mode="after")
    def _ranged(self) -> Self:
        if (self.ranges.q_lower >= self.ranges.q_upper).any():
            raise OptionError("a lower limit isn't below its upper one", "Exchange them")
        return self
