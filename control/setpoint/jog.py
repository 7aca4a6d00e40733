"""Joints that move slowly while a key is pressed again and again: the law behind `srl jog`."""

from __future__ import annotations

from math import isfinite
from typing import Final, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.per_element import Positive
from srl.runtime.contracts.signals import Signal

HOLD: Final = 0.12  # s of motion that one press gives
REST: Final = 1.2  # s without a press after a reset: longer than any console waits before it repeats a held key


class JogConfig(ControllerConfig):
    """Options of `jog`."""

    speed: dict[str, Positive] = Field(min_length=1, description="rad/s or m/s, by joint, in the command's order")
    acceleration: dict[str, Positive] = Field(description="rad/s2 or m/s2, by joint: how it begins and brakes")
    command: Literal["position", "velocity"] = "position"
    unit: str = Field("rad", description="the command's own unit")
    slides: tuple[str, ...] | None = Field(None, description="joints that slide, as the command says")
    hold: float = Field(HOLD, gt=0.0, le=0.5, description="s that one press moves; then the joint brakes")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if set(self.acceleration) != set(self.speed):
            raise ValueError("'acceleration' must have the joints of 'speed'")
        return self


class Jog(Controller):
    """Moves joints for `hold` seconds after each press, and brakes by itself: nobody has to say that a key was let go.

    Input `way` (n,), -1 to 1: the sense of each joint's motion, a share of its speed. Input `press` (1,): the number
    of the newest press, or 0 while there is none. A new number takes `way` over and gives `hold` seconds more. Outputs
    `q` (n,) and `q_velocity` (n,), or `velocity` (n,), in the command's units.

    A position is commanded from the applied one on, so it never runs ahead of what the guard allows. After a reset the
    joints stand until `press` has been 0 for REST: a key that is held through a reset moves nothing.
    """

    Config = JogConfig
    summary = "joints moved while a key is pressed, for bring-up (srl jog)"

    def __init__(self, name: str, config: JogConfig) -> None:
        super().__init__(name, config)
        joints, unit, slides = tuple(config.speed), config.unit, config.slides
        n = len(joints)
        self.inputs = (
            Signal(name="way", shape=(n,), unit="1", labels=joints),
            Signal(name="press", shape=(1,), unit="1"),
        )
        if config.command == "position":
            self.outputs = (
                Signal(name="q", shape=(n,), unit=unit, labels=joints, slides=slides),
                Signal(name="q_velocity", shape=(n,), unit=f"{unit}/s", labels=joints, slides=slides),
            )
        else:
            self.outputs = (Signal(name="velocity", shape=(n,), unit=unit, labels=joints, slides=slides),)
        self._position, self._hold = config.command == "position", config.hold
        self._speed = np.array(list(config.speed.values()))
        self._acceleration = np.array([config.acceleration[joint] for joint in joints])
        self._way, self._v = np.zeros(n), np.zeros(n)
        self._press = self._left = 0.0
        self._rest = REST  # s without a press that are still needed after a reset

    def reset(self) -> None:
        self._v[:] = 0.0
        self._left, self._rest = 0.0, REST
        if self._position:
            q = self.output["q"]
            q[:] = self.applied.get("q", q)
            self.output["q_velocity"][:] = 0.0
        else:
            self.output["velocity"][:] = 0.0

    def update(self, dt: float) -> None:
        self._listen(dt)
        wanted = self._way * self._speed if self._left > 1e-9 else 0.0
        self._left -= dt
        step = self._acceleration * dt
        last = self._v
        self._v = np.clip(wanted, last - step, last + step)
        if not self._position:
            self.output["velocity"][:] = self._v
            return
        q = self.output["q"]
        moves = (last != 0.0) | (self._v != 0.0)
        # A joint at rest keeps its command: what was sent is rounded, and would creep.
        q[moves] = (self.applied.get("q", q) + (last + self._v) / 2 * dt)[moves]
        self.output["q_velocity"][:] = self._v

    def _listen(self, dt: float) -> None:
        press, way = float(self.input["press"][0]), self.input["way"]
        if not isfinite(press) or not np.isfinite(way).all():
            press = 0.0
        if self._rest > 0.0:
            self._rest = REST if press else self._rest - dt
        elif press and press != self._press:
            self._way, self._left = np.clip(way, -1.0, 1.0), self._hold
        self._press = press or self._press
