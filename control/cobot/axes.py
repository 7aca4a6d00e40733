"""The types of these laws' options that have a value for each axis; each can be given by name."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from srl.runtime.contracts.per_element import Finite, PerElement, Positive
from srl.runtime.contracts.terms import PLANAR_TWIST, POINT, TWIST, WRENCH

_NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_KINDS = PerElement(("force", "torque"))

Point = Annotated[tuple[Finite, Finite, Finite], PerElement(POINT)]
Wrench = Annotated[tuple[Finite, Finite, Finite, Finite, Finite, Finite], PerElement(WRENCH)]
OnTwist = Annotated[tuple[Positive, Positive, Positive, Positive, Positive, Positive], PerElement(TWIST)]
"""What acts on each axis of a twist: masses, dampings, gains."""
OnPlanarTwist = Annotated[tuple[Positive, Positive, Positive], PerElement(PLANAR_TWIST)]
ForceTorque = Annotated[tuple[Positive, Positive], _KINDS]
DeadBand = Annotated[tuple[_NotNegative, _NotNegative], _KINDS]
MassInertia = Annotated[tuple[Positive, Positive], PerElement(("mass", "inertia"), ordered=False)]
