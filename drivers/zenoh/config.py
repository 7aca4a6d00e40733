"""Options of a device that consists of a set of zenoh keys."""

from __future__ import annotations

import math
import re

from pydantic import ConfigDict, Field, field_validator

from srl.drivers.zenoh.values import TERMS, TYPES
from srl.drivers.zenoh_link import PeerConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import nearest
from srl.runtime.contracts.signals import Signal

_KEY = re.compile(r"^[A-Za-z0-9_%:-]+(/[A-Za-z0-9_%:-]+)*$")
_NAME = re.compile(r"^[a-z][a-z0-9_]*(\.[a-z0-9_]+)*$")
_INSTANCE = re.compile(r"^srl/(?P<name>[^/]+)/")


class SignalEntry(BaseModel):
    """One signal: its key, and the properties it must have."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    key: str = Field(description="'srl/other/state/glove/position', or a topic of the bridge: 'robot/imu/pose'")
    shape: tuple[int, ...] = Field(description="of the values, e.g. [22]")
    unit: str = Field(description="SI")
    frame: str | None = Field(None, description="the frame of its coordinates")
    labels: tuple[str, ...] = Field(
        (), description="names of the elements, in the order they get here; a pose, twist, wrench or point has its own"
    )
    slots: bool = Field(False, description="its rows have no names, as unlabelled markers")
    components: tuple[tuple[str, ...], ...] = Field((), description="names along each further axis")
    type: str | None = Field(None, description="'sensor_msgs/msg/JointState'; needed where the sender declares none")
    field: str | None = Field(None, description="of a JointState: position, velocity, effort; of a Joy: axes, buttons")
    nan: bool = Field(False, description="let samples with NaN through (markers out of sight)")

    @field_validator("shape")
    @classmethod
    def _shape(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if not value or any(n < 1 for n in value) or math.prod(value) > 4096:
            raise ValueError("must list whole numbers above 0, with 4096 values at most")
        return value

    @field_validator("key")
    @classmethod
    def _key(cls, value: str) -> str:
        if not _KEY.match(value):
            raise ValueError("must be one key without wildcards, such as srl/other/state/glove/position")
        return value

    @field_validator("type")
    @classmethod
    def _type(cls, value: str | None) -> str | None:
        if value is not None and value not in TYPES:
            raise ValueError(f"'{value}' isn't a message read here. {nearest(value, TYPES)}")
        return value

    @property
    def instance(self) -> str | None:
        """The name, on the bus, of the runtime that publishes the signal; None for other senders."""
        match = _INSTANCE.match(self.key)
        return match["name"] if match else None


class ZenohConfig(PeerConfig):
    """Options of the device."""

    signals: dict[str, SignalEntry] = Field(min_length=1, description="by the name it gets here")
    silence: float = Field(1.0, ge=0.2, le=10, description="s without a new sample until the link is opened anew")

    @field_validator("signals")
    @classmethod
    def _names(cls, value: dict[str, SignalEntry]) -> dict[str, SignalEntry]:
        for name in value:
            if not _NAME.match(name):
                raise ValueError(f"'{name}' isn't a signal's name: lower-case letters, digits and _, with dots between")
        return value

    def states(self) -> tuple[Signal, ...]:
        """Returns the signals, as declared by both the driver and its fake."""
        return tuple(
            Signal(
                name=name, shape=e.shape, unit=e.unit, frame=e.frame,
                labels=e.labels or TERMS.get(e.type or "", ()), slots=e.slots, components=e.components,
            )
            for name, e in self.signals.items()
        )  # fmt: skip
