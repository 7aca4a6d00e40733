"""The law `finger-closure`: a control value opens and closes a robotic finger, continuously."""

from __future__ import annotations

from math import isfinite
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.per_element import Finite, in_order
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.models.models import FingerOption, named

_FASTEST = 1e3  # 1/s; a rate beyond it is no person's, and its product might overflow


class FingerClosureConfig(ControllerConfig):
    """Options of `finger-closure`."""

    model: FingerOption = named("finger")
    open: dict[str, Finite] | Finite = Field(description="rad, by joint: the posture at c = 0")
    closed: dict[str, Finite] | Finite = Field(description="rad, by joint: the posture at c = 1")
    catch_up: float = Field(
        1.0,
        gt=0.0,
        allow_inf_nan=False,
        description="rad/s, how fast a joint goes to where it should be after it was held or reset",
    )

    @model_validator(mode="after")
    def _within(self) -> Self:
        model = self.model
        for key in ("open", "closed"):
            try:
                posture = self.posture(getattr(self, key))
            except OptionError as error:
                raise OptionError(f"{key}: {error.problem}", error.remedy) from None
            for joint, value, low, high in zip(model.names, posture.tolist(), model.lower, model.upper, strict=True):
                if not low <= value <= high:
                    problem = f"{key}: {joint} goes from {low:.3f} to {high:.3f} rad, and this is {value:.3f}"
                    raise OptionError(problem, "Choose a posture that the finger can take")
        if np.array_equal(self.posture(self.open), self.posture(self.closed)):
            raise OptionError("`open` and `closed` are the same posture", "Give two, between which the finger moves")
        return self

    def posture(self, given: Any) -> Array:
        """(n,) rad, in the order of the model's joints. Raises OptionError."""
        return np.array(in_order(given, self.model.names), dtype=float)


class FingerClosure(Controller):
    """Maps the range of a control value to a finger's range of motion: q = open + c (closed - open).

    Inputs: `c` (1,), 0 open to 1 closed; `c_rate` (1,) 1/s, its rate. Outputs: `q` (n,) rad, and its rate
    `q_velocity` (n,) rad/s. A c beyond its range counts as the range's end. While c isn't finite the finger holds; a
    rate that isn't finite counts as zero. After a reset it begins at the applied posture and, like after a hold, comes
    to c's at `catch_up`, on top of c's own motion.

    Source: Lisini Baldi et al. 2023, III-C: "the range of the IKNS control signal was mapped into the finger range of
    motion".
    """

    Config = FingerClosureConfig
    summary = "opens and closes an extra finger by a control value from 0 to 1"

    def __init__(self, name: str, config: FingerClosureConfig) -> None:
        super().__init__(name, config)
        names = config.model.names
        n = len(names)
        self._open, closed = config.posture(config.open), config.posture(config.closed)
        self._span = closed - self._open
        self._lower, self._upper = np.minimum(self._open, closed), np.maximum(self._open, closed)
        self._catch_up = config.catch_up
        self.inputs = (Signal(name="c", shape=(1,), unit="1"), Signal(name="c_rate", shape=(1,), unit="1/s"))
        self.outputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=names),
            Signal(name="q_velocity", shape=(n,), unit="rad/s", labels=names),
        )
        self._behind = np.zeros(n)  # rad, of each joint from where c wants it
        self._lost = False

    def reset(self) -> None:
        """Begins at the applied posture; without a device, at c's own if c is finite, else where it was."""
        wanted, q = self._wanted(), self.output["q"]
        begin = q if wanted is None else wanted
        q[:] = self.applied.get("q", begin)
        self._lost = wanted is None
        self._behind = np.zeros(q.shape) if wanted is None else q - wanted
        self.output["q_velocity"][:] = 0.0

    def update(self, dt: float) -> None:
        q, velocity, wanted = self.output["q"], self.output["q_velocity"], self._wanted()
        if wanted is None:
            self._lost = True
            velocity[:] = 0.0
            return
        if self._lost:
            self._lost = False
            self._behind = q - wanted
        if not self._behind.any():
            q[:] = wanted
            np.multiply(self._span, self._rate(), out=velocity)
            return
        step = self._catch_up * dt
        self._behind -= self._behind.clip(-step, step)
        # What it lags behind may not lead it out of its range, or further out.
        reached = np.clip(wanted + self._behind, np.minimum(self._lower, q), np.maximum(self._upper, q))
        np.subtract(reached, wanted, out=self._behind)
        np.divide(reached - q, dt, out=velocity)
        q[:] = reached

    def _wanted(self) -> Array | None:
        """(n,) rad, the posture for the present c; None if c isn't finite."""
        c = self.input["c"].item()
        if not isfinite(c):
            return None
        wanted: Array = self._open + min(max(c, 0.0), 1.0) * self._span
        return wanted

    def _rate(self) -> float:
        """1/s, how fast the c that counts changes."""
        c, rate = self.input["c"].item(), self.input["c_rate"].item()
        return rate if abs(rate) < _FASTEST and 0.0 <= c <= 1.0 else 0.0
