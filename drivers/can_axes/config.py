"""One axis of a limb whose drives are on a CAN bus, in the profile."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from srl.drivers.can_axes.signals import command_of
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.signals import Limits

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Mode = Literal["position", "velocity", "torque"]
TURN: Final = 6.283185307179586  # rad


class CanAxis(BaseModel, ABC):
    """One axis. With the angle s of the drive's shaft (rad, 0 where the drive says 0): axis = ±(s - zero)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    reversed: bool = Field(False, description="the axis grows as the shaft's angle falls")
    lower: Finite | None = Field(None, description="rad, lowest position of the axis")
    upper: Finite | None = Field(None, description="rad, highest position of the axis")
    home: Finite | None = Field(None, description="rad, where 'retract' goes; give it to all axes or to none")
    velocity: Positive = Field(description="rad/s, fastest motion of the axis; the drive is given it as its limit")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        return self

    @property
    def sign(self) -> float:
        """1, or -1 if reversed."""
        return -1.0 if self.reversed else 1.0

    @property
    @abstractmethod
    def number(self) -> int:
        """The drive's id on the bus."""

    @property
    @abstractmethod
    def most_torque(self) -> float:
        """N m at the axis, at the most current that the profile allows."""

    @property
    @abstractmethod
    def place(self) -> float | None:
        """rad, where the axis must stand when the drive is switched on and when a run opens; None: it knows where."""


class CanAxesConfig(DeviceConfig, ABC):
    """Drives on one CAN bus. All arrays have the order of `axes`."""

    port: str = Field(description="can://INTERFACE/CHANNEL, e.g. can://socketcan/can0")
    bitrate: float = Field(1_000_000, gt=0, description="bit/s of the bus, for what it can carry; it isn't set")
    mode: Mode = Field("position", description="what is commanded")
    start_tolerance: Positive = Field(
        0.1, description="rad; an axis whose first command is farther from where it stands isn't moved"
    )
    park_tolerance: Positive = Field(
        0.1, description="rad; a run opens only if each axis with `parked` says that it is this near to it"
    )

    @property
    @abstractmethod
    def all_axes(self) -> Mapping[str, CanAxis]:
        """The axes by name."""

    @property
    def command(self) -> str:
        """The name of the command signal."""
        return command_of(self.mode)

    def check_axes(self) -> None:
        """Raises ValueError for an id that is used twice, or a home that some axes lack."""
        taken: dict[int, str] = {}
        for name, axis in self.all_axes.items():
            if axis.number in taken:
                raise ValueError(f"id {axis.number} is used twice, by {taken[axis.number]} and {name}")
            taken[axis.number] = name
        homes = [name for name, axis in self.all_axes.items() if axis.home is not None]
        if homes and len(homes) < len(self.all_axes):
            missing = next(name for name in self.all_axes if name not in homes)
            raise ValueError(f"{missing} has no home, others have; give it to all axes or to none")

    @property
    def limits(self) -> Limits:
        """The bounds that the profile gives the axes."""
        axes = self.all_axes.values()
        lower = np.array([-np.inf if axis.lower is None else axis.lower for axis in axes])
        upper = np.array([np.inf if axis.upper is None else axis.upper for axis in axes])
        return Limits(
            lower=lower if np.isfinite(lower).any() else None,
            upper=upper if np.isfinite(upper).any() else None,
            velocity=np.array([axis.velocity for axis in axes]),
            effort=np.array([axis.most_torque for axis in axes]) if self.mode == "torque" else None,
        )
