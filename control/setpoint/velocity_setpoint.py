"""A velocity set by a client of the bus, for jogging arms and bases during bring-up."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.signals import Signal


class VelocitySetpointConfig(ControllerConfig):
    """Options of `velocity-setpoint`."""

    axes: tuple[str, ...] = Field(min_length=1, description="a label for each axis, in the command's order")
    unit: str = Field("rad/s", description="the command's own unit")


class VelocitySetpoint(Controller):
    """Passes a client's velocity on. The guard bounds it and its change.

    Input `target` (n,) and output `velocity` (n,), both in the command's unit. The velocity is zero while the target
    isn't finite, and after a reset until a client sends a target that differs from the one at the reset.
    """

    Config = VelocitySetpointConfig
    summary = "velocities set by a client, for bring-up"

    def __init__(self, name: str, config: VelocitySetpointConfig) -> None:
        super().__init__(name, config)
        axes = config.axes
        if len(set(axes)) < len(axes):
            raise ProfileError(f"controllers.{name}.axes", "a label is there more than once", "Name each once")
        self.inputs = (Signal(name="target", shape=(len(axes),), unit=config.unit, labels=axes),)
        self.outputs = (Signal(name="velocity", shape=(len(axes),), unit=config.unit, labels=axes),)
        self._old = np.full(len(axes), np.nan)
        self._new = False

    def reset(self) -> None:
        self._old[:] = self.input["target"]
        self._new = False
        self.output["velocity"][:] = 0.0

    def update(self, dt: float) -> None:
        target, velocity = self.input["target"], self.output["velocity"]
        if not np.isfinite(target).all():
            velocity[:] = 0.0
            return
        self._new = self._new or not np.array_equal(target, self._old)
        if self._new:
            velocity[:] = target
