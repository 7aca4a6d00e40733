"""The law `finger-closure`: a control value opens and closes a robotic finger."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from runtime.contracts.controller import Controller, ControllerConfig
from runtime.contracts.errors import OptionError
from runtime.contracts.per_element import Finite, in_order
from runtime.contracts.signals import Array, Signal
from runtime.control.models import FingerOption, named

_CATCH_UP = 1.0  # 1/s, of the way from open to closed, after a reset


class FingerClosureConfig(ControllerConfig):
    """Options of `finger-closure`."""

    model: FingerOption = named("finger")
    open: dict[str, Finite] | Finite = Field(description="rad, by joint, at c = 0")
    closed: dict[str, Finite] | Finite = Field(description="rad, by joint, at c = 1")

    @model_validator(mode="after")
    def _named(self) -> Self:
        for key in ("open", "closed"):
            try:
                in_order(getattr(self, key), self.model.names)
            except OptionError as error:
                raise OptionError(f"{key}: {error.problem}", error.remedy) from None
        return self

    def posture(self, given: Any) -> Array:
        """(n,) rad."""
        return np.array(in_order(given, self.model.names), dtype=float)


class FingerClosure(Controller):
    """Maps a control value to a finger's joints, linearly from open to closed.

    Inputs: `c` (1,), 0 to 1; `c_rate` (1,) 1/s. Outputs: `q` (n,) rad, `q_velocity` (n,) rad/s. After a reset it begins
    where the finger is, and catches up.
    """

    Config = FingerClosureConfig
    summary = "a control value from 0 to 1 opens and closes a robotic finger"

    def __init__(self, name: str, config: FingerClosureConfig) -> None:
        super().__init__(name, config)
        names = config.model.names
        self._open = config.posture(config.open)
        self._span = config.posture(config.closed) - self._open
        self.inputs = (Signal(name="c", shape=(1,), unit="1"), Signal(name="c_rate", shape=(1,), unit="1/s"))
        self.outputs = (
            Signal(name="q", shape=(len(names),), unit="rad", labels=names),
            Signal(name="q_velocity", shape=(len(names),), unit="rad/s", labels=names),
        )
        self._behind = np.zeros(len(names))

    def reset(self) -> None:
        wanted = self._open + self.input["c"] * self._span
        q = self.output["q"]
        q[:] = self.applied.get("q", wanted)
        self._behind = q - wanted
        self.output["q_velocity"][:] = 0.0

    def update(self, dt: float) -> None:
        step = _CATCH_UP * dt * np.abs(self._span)
        self._behind -= self._behind.clip(-step, step)
        self.output["q"][:] = self._open + self.input["c"] * self._span + self._behind
        self.output["q_velocity"][:] = self.input["c_rate"] * self._span
