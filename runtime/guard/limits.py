"""The guard's limits: the profile's entries, their conversion to arrays, and the narrower of two sources."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, WiringError
from srl.runtime.contracts.per_element import Finite, Positive, in_order
from srl.runtime.contracts.signals import Array, Limits

INTENSITY = ("level", "level_rate", "on_time", "duty")
"""The limits of what the wearer feels, which has no other, and no other command has these."""

NAMES = ("lower", "upper", "velocity", "acceleration", "jerk", "effort", "effort_rate", "inertia", *INTENSITY)

Anywhere = Finite | list[Finite] | dict[str, Finite] | None
Above0 = Positive | list[Positive] | dict[str, Positive] | None
Share = Annotated[Positive, Field(le=1.0)]
UpTo1 = Share | list[Share] | dict[str, Share] | None


LEAST_DUTY = 0.2  # less would end a contact that lasts, or a cue after it, before it is felt


class GuardLimits(BaseModel):
    """One command's limits in the profile's `guard:`: a number for every joint, or one for each by its name.

    A list is read only where the order is the robot's own.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    lower: Anywhere = Field(None, description="lowest position, rad or m")
    upper: Anywhere = Field(None, description="highest position, rad or m")
    velocity: Above0 = Field(None, description="rad/s or m/s")
    acceleration: Above0 = Field(None, description="rad/s^2 or m/s^2")
    jerk: Above0 = Field(None, description="rad/s^3 or m/s^3; none: unbounded")
    effort: Above0 = Field(None, description="N m or N")
    effort_rate: Above0 = Field(None, description="N m/s or N/s")
    inertia: Above0 = Field(
        None, description="kg m^2 or kg, the least that the joint moves alone; bounds the damping of torque stops"
    )
    level: UpTo1 = Field(None, description="of an intensity: the most, up to 1")
    level_rate: Above0 = Field(None, description="of an intensity, 1/s: how fast it rises; it falls at once")
    on_time: Above0 = Field(None, description="of an intensity, s of being on, between pauses of 0.5 s")
    duty: UpTo1 = Field(None, description=f"of an intensity: its mean over time, at most; {LEAST_DUTY:g} to 1")
    tolerance: Positive = Field(1e-3, le=1.0, description="a command changed by more than this counts as limited")

    def to_limits(
        self, shape: tuple[int, ...], place: str, labels: tuple[str, ...] = (), ordered: bool = True
    ) -> Limits:
        """Converts the limits to arrays of the command's shape.

        Args:
            shape: the command's shape.
            place: the place of these limits in the profile, for the error.
            labels: the command's.
            ordered: whether their order is the robot's own, so that a list can be read.
        Raises:
            WiringError: a list has the wrong length or no order, or other joints are named.
        """
        size = int(np.prod(shape, dtype=int))
        arrays: dict[str, Array] = {}
        for name in NAMES:
            value = getattr(self, name)
            if value is None:
                continue
            try:
                values = in_order(value, labels, size=size, ordered=ordered)
            except OptionError as error:
                raise WiringError(f"{place}.{name}", error.problem, error.remedy) from None
            arrays[name] = np.array(values, np.float64).reshape(shape)
        return Limits(**arrays)


def merge(a: Limits, b: Limits) -> Limits:
    """The narrower of two limits, element by element. If one source has no limit, the other's applies."""
    merged: dict[str, Array] = {}
    for name in NAMES:
        x, y = getattr(a, name), getattr(b, name)
        if x is None and y is None:
            continue
        narrower = np.maximum if name == "lower" else np.minimum
        merged[name] = x if y is None else y if x is None else narrower(x, y)
    return Limits(**merged)
