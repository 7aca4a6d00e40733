"""The gripper of a guided robot: converts a mode to a closure that moves at a limited speed."""

from __future__ import annotations

from pydantic import Field

from srl.control.cobot.guide_buttons import GRIPPER, MODES
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Signal


class GripperConfig(ControllerConfig):
    """Options of `gripper`."""

    opened: float = Field(0.0, ge=0, le=1, description="closure while open")
    closed: float = Field(1.0, ge=0, le=1, description="closure while closed; less for something brittle")
    speed: float = Field(1.0, gt=0, allow_inf_nan=False, description="1/s, of the closure")
    lead: float = Field(0.1, gt=0, description="how far the closure may be ahead of what the guard let through")


class Gripper(Controller):
    """Opens and closes a gripper at a limited speed.

    Input `modes` (4,), of which the third closes the gripper. Outputs `closure` (1,), 0 open to 1 closed, and its
    `velocity` (1,), 1/s.
    """

    Config = GripperConfig
    summary = "opens and closes a SoftHand at a limited speed"

    def __init__(self, name: str, config: GripperConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="modes", shape=(4,), unit="1", labels=MODES),)
        self.outputs = (
            Signal(name="closure", shape=(1,), unit="1", labels=("closure",)),
            Signal(name="velocity", shape=(1,), unit="1/s", labels=("closure",)),
        )
        self._config = config
        self._closure = 0.0

    def reset(self) -> None:
        """Starts at the hand's applied closure."""
        self._closure = self._applied()
        self.output["closure"][0], self.output["velocity"][0] = self._closure, 0.0

    def update(self, dt: float) -> None:
        c, last = self._config, self._closure
        target = c.closed if self.input["modes"][GRIPPER] > 0.5 else c.opened
        step = c.speed * dt
        closure = min(max(target, last - step), last + step)
        applied = self._applied()
        closure = min(max(closure, applied - c.lead), applied + c.lead)
        self._closure = closure
        self.output["closure"][0] = closure
        self.output["velocity"][0] = min(max((closure - last) / dt, -c.speed), c.speed) if dt > 0 else 0.0

    def _applied(self) -> float:
        return float(self.applied["closure"][0]) if "closure" in self.applied else self._closure
