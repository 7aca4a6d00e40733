"""Joint angles set by a client of the bus, for jogging a finger during bring-up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from pydantic import Field

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.signals import Signal


class JointSetpointConfig(ControllerConfig):
    """Options of `joint-setpoint`."""

    joints: tuple[str, ...] = Field(min_length=1, description="a label for each joint, in the command's order")
    unit: str = Field("rad", description="the command's own unit: rad, m, 1")


class JointSetpoint(Controller):
    """Passes a client's target on to the joints. The guard makes the motion.

    Input `target` (n,); if any value is NaN, no target has arrived. Outputs `q` (n,) in the same unit and
    `q_velocity` (n,), zero. After a reset the controller holds the applied position until a target arrives that
    differs from the one at the reset. So leaving a stop never resumes an old motion.
    """

    Config = JointSetpointConfig
    passes: ClassVar[Mapping[str, str]] = {"target": "q"}
    summary = "joint angles set by a client, for bring-up"

    def __init__(self, name: str, config: JointSetpointConfig) -> None:
        super().__init__(name, config)
        joints = config.joints
        if len(set(joints)) < len(joints):
            raise ProfileError(f"controllers.{name}.joints", "a label is there more than once", "Name each once")
        n = len(joints)
        self.inputs = (Signal(name="target", shape=(n,), unit=config.unit, labels=joints),)
        self.outputs = (
            Signal(name="q", shape=(n,), unit=config.unit, labels=joints),
            Signal(name="q_velocity", shape=(n,), unit=f"{config.unit}/s", labels=joints),
        )
        self._old = np.full(n, np.nan)
        self._new = False

    def reset(self) -> None:
        self._old[:] = self.input["target"]
        self._new = False
        q = self.output["q"]
        q[:] = self.applied.get("q", q)
        self.output["q_velocity"][:] = 0.0

    def update(self, dt: float) -> None:
        target = self.input["target"]
        if not np.isfinite(target).all():
            return
        self._new = self._new or not np.array_equal(target, self._old)
        if self._new:
            self.output["q"][:] = target
