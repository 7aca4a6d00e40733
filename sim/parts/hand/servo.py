"""The hobby servos of the extra finger: a torque-speed line, a stiff position loop, a dead band."""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
from pydantic import ConfigDict, Field

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.signals import Array
from srl.sim.world.mjcf import add


class ServoConfig(BaseModel):
    """A servo at its output shaft; the defaults are those of a micro analog servo (sheet human_hand)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    stall_torque: float = Field(default=0.14, gt=0, description="N m, the greatest torque, at rest")
    no_load_speed: float = Field(default=8.0, gt=0, description="rad/s, where the torque has fallen to zero")
    stiffness: float = Field(default=3.0, gt=0, description="N m/rad of position error, up to the stall torque")
    damping: float = Field(
        default=0.05, ge=0, description="N m s/rad, the position loop's own (it brakes before the goal)"
    )
    armature: float = Field(default=3e-4, gt=0, description="kg m^2, rotor and gears seen at the shaft")
    friction: float = Field(default=0.004, ge=0, description="N m, dry friction of the gears")
    dead_band: float = Field(
        default=0.0068,
        ge=0,
        description="rad; a smaller change of the command is ignored (4 us at 590 us/rad)",
    )


def add_servo(body: Element, actuators: Element, name: str, limits: tuple[float, float], servo: ServoConfig) -> None:
    """Adds a hinge about the body's z axis and the servo that drives it, both named `name`.

    The torque available at speed w is stall_torque - (stall_torque / no_load_speed) w. The line's slope is the joint's
    damping. It acts inside and outside the position loop alike, and remains when the servo is limp.

    Args:
        body: the body that the servo moves.
        actuators: the `actuator` element.
        name: name of the joint and the actuator.
        limits: rad, mechanical end stops.
        servo: the servo's parameters.
    """
    add(
        body,
        "joint",
        name=name,
        axis="0 0 1",
        range=limits,
        armature=servo.armature,
        damping=servo.stall_torque / servo.no_load_speed,
        frictionloss=servo.friction,
    )
    add(
        actuators,
        "general",
        name=name,
        joint=name,
        gainprm=servo.stiffness,
        biastype="affine",
        biasprm=(0.0, -servo.stiffness, -servo.damping),
        forcerange=(-servo.stall_torque, servo.stall_torque),
    )


class ServoBank:
    """The servos' commands: the pulse that each one holds, and pulses that are still in transit.

    Attributes:
        held: (n,) rad, the target that each servo holds; NaN while it gets no pulses and is limp.
    """

    def __init__(self, dead_bands: Array) -> None:
        self.held = np.full(dead_bands.shape, np.nan)
        self._dead_bands: list[float] = dead_bands.tolist()
        self._pending: dict[int, dict[int, float]] = {}  # by step, then servo: rad or NaN

    def command(self, servo: int, target: float, step: int) -> None:
        """Gives a servo `target` (rad; NaN: pulses end) at step `step`; the last command for a step counts."""
        self._pending.setdefault(step, {})[servo] = target

    def next_step(self) -> int | None:
        """The step at which the next pulse arrives."""
        return min(self._pending) if self._pending else None

    def latch(self, step: int) -> bool:
        """Applies what has arrived by `step`; returns True if a servo's target changed."""
        changed = False
        while self._pending and (due := min(self._pending)) <= step:
            for servo, target in self._pending.pop(due).items():
                change = abs(target - self.held.item(servo))
                if not change < self._dead_bands[servo]:  # also true if either is NaN
                    self.held[servo] = target
                    changed = True
        return changed

    def save(self) -> Array:
        """(n + 3 k,), with k pulses in transit."""
        pending = [(step, *word) for step, words in sorted(self._pending.items()) for word in words.items()]
        return np.concatenate([self.held, np.array(pending, dtype=float).ravel()])

    def restore(self, state: Array) -> None:
        """Restores a state returned by `save`."""
        n = self.held.size
        self.held[:] = state[:n]
        self._pending = {}
        for step, servo, target in state[n:].reshape(-1, 3).tolist():
            self.command(int(servo), target, int(step))
