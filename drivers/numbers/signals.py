"""What the profile says of numbers that a device sends: where each is, its unit, its bounds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any, Final, Generic, TypeVar

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.signals import Array, Signal

NAME: Final = re.compile(r"^[a-z][a-z0-9_]*$")
Finite = Annotated[float, Field(allow_inf_nan=False)]
Where = TypeVar("Where", int, str)
"""Where a number is: a column from 1 on, or a path."""


class NumberSignal(BaseModel, Generic[Where]):
    """One signal (n,): numbers of the device, in SI. value = gain * number + offset."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    elements: dict[str, Where] = Field(min_length=1, max_length=256, description="name here: where the number is")
    unit: str = Field(min_length=1, description="SI, of the values here; 1 for none")
    frame: str | None = Field(None, description="the frame of its coordinates")
    gain: Finite | dict[str, Finite] = Field(1.0, description="units of the signal for 1 of the number")
    offset: Finite | dict[str, Finite] = Field(0.0, description="in the signal's unit, where the number is 0")
    lower: Finite = Field(-1e12, description="in the signal's unit; a sample below it is none")
    upper: Finite = Field(1e12, description="in the signal's unit; a sample above it is none")

    @model_validator(mode="after")
    def _fits(self) -> NumberSignal[Where]:
        if not self.lower < self.upper:
            raise ValueError(f"lower ({self.lower:g}) must be less than upper ({self.upper:g})")
        for key in ("gain", "offset"):
            given = getattr(self, key)
            if isinstance(given, dict) and set(given) != set(self.elements):
                raise ValueError(f"{key}: it has {', '.join(given)}, the elements are {', '.join(self.elements)}")
        if 0.0 in self.each("gain"):
            raise ValueError("gain: 0 would make every number the same")
        return self

    def each(self, key: str) -> list[float]:
        """`gain` or `offset` of each element."""
        given = getattr(self, key)
        return [given[name] for name in self.elements] if isinstance(given, dict) else [given] * len(self.elements)

    def signal(self, name: str) -> Signal:
        """The state that it is."""
        return Signal(
            name=name, shape=(len(self.elements),), unit=self.unit, frame=self.frame, labels=tuple(self.elements)
        )


class NumbersConfig(DeviceConfig):
    """Options of every such device; a subclass declares `signals`."""

    signals: Mapping[str, NumberSignal[Any]]
    rate: float = Field(0.0, ge=0, le=4000, description="Hz, at which it sends; 0: when it likes")
    latency: float = Field(0.0, ge=0, le=1.0, description="s, from the person to the first byte")
    silence: float = Field(1.0, ge=0.05, le=60, description="s without a sample until the device is opened anew")
    frozen: float | None = Field(
        None, gt=0, allow_inf_nan=False,
        description="s for which all numbers may be the same to the last digit; then they are none. None: for ever",
    )  # fmt: skip

    @field_validator("signals", check_fields=False)
    @classmethod
    def _names(cls, value: Mapping[str, Any]) -> Mapping[str, Any]:
        for name in value:
            if not NAME.match(name):
                raise ValueError(f"'{name}' can't be a signal's name: small letters, digits, _")
        return value

    def states(self) -> tuple[Signal, ...]:
        """The signals, as declared by both the driver and its fake."""
        return tuple(entry.signal(name) for name, entry in self.signals.items())


class Numbers:
    """Turns the numbers of a sample into the states of a device."""

    def __init__(self, config: NumbersConfig) -> None:
        self.places: list[Any] = []
        """Where each number is, signal after signal; a place may be there twice."""
        self._parts: list[tuple[str, slice, Array, Array, NumberSignal[Any]]] = []
        for name, entry in config.signals.items():
            begin = len(self.places)
            self.places += entry.elements.values()
            gain, offset = np.array(entry.each("gain")), np.array(entry.each("offset"))
            self._parts.append((name, slice(begin, len(self.places)), gain, offset, entry))

    def take(self, numbers: list[float], states: Mapping[str, Array]) -> str:
        """Writes a sample into the states, whole or not at all.

        Args:
            numbers: in the order of `places`.
            states: the device's arrays.
        Returns:
            Why it is none; "" if it is one.
        """
        if not all(map(isfinite, numbers)):
            return "a number isn't finite"
        values = np.array(numbers)
        found = [(name, gain * values[own] + offset) for name, own, gain, offset, _ in self._parts]
        for (name, value), (*_, entry) in zip(found, self._parts, strict=True):
            for label, x in zip(entry.elements, value.tolist(), strict=True):
                if not entry.lower <= x <= entry.upper:
                    return f"{name}[{label}] {x:g} isn't between {entry.lower:g} and {entry.upper:g}"
        for name, value in found:
            states[name].flat[:] = value
        return ""

    def numbers(self, values: Array) -> list[float]:
        """The numbers (n,) that stand for values (n,) in SI, in the order of `places`: what a twin sends."""
        out = np.empty(len(self.places))
        for _, own, gain, offset, _ in self._parts:
            out[own] = (values[own] - offset) / gain
        found: list[float] = out.tolist()
        return found
