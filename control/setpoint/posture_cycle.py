"""A limb that goes from posture to posture, round and round: the motion of the human-SRL skeleton's test."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.per_element import Finite, in_order
from srl.runtime.contracts.signals import Array, Signal


class PostureCycleConfig(ControllerConfig):
    """Options of `posture-cycle`."""

    postures: tuple[dict[str, Finite], ...] = Field(min_length=2, description="rad or m, by joint, in their order")
    near: dict[str, Finite] | Finite = Field(
        0.05, description="rad or m, by joint: all this near to it, it has arrived"
    )
    rest: float = Field(1.0, ge=0.0, description="s at each posture, and before the first motion")
    unit: str = Field("rad", description="the command's own unit: rad, m")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for i, posture in enumerate(self.postures):
            try:
                in_order(posture, self.joints)
            except OptionError as error:
                raise OptionError(f"postures.{i}: {error.problem}", error.remedy) from None
        if min(in_order(self.near, self.joints)) <= 0.0:
            raise ValueError("near must be more than 0")
        return self

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints' names."""
        return tuple(self.postures[0])


class PostureCycle(Controller):
    """Commands one posture after the other and begins again; the next one once the limb has arrived and rested.

    Input `position` (n,), rad or m, measured. Outputs `q` (n,) in the same unit, and `q_velocity` (n,), zero: the guard
    makes the motion. After a reset it holds the applied position for `rest`, then goes on to the posture that it went
    to before.

    Source: Zhang, Liu, Li 2022, 5.2: "only when the differences between the current position values and the given
    position values meet a certain threshold, the next configuration command will be sent".
    """

    Config = PostureCycleConfig
    summary = "moves a limb between postures, round and round"

    def __init__(self, name: str, config: PostureCycleConfig) -> None:
        super().__init__(name, config)
        joints = config.joints
        n = len(joints)
        self.inputs = (Signal(name="position", shape=(n,), unit=config.unit, labels=joints),)
        self.outputs = (
            Signal(name="q", shape=(n,), unit=config.unit, labels=joints),
            Signal(name="q_velocity", shape=(n,), unit=f"{config.unit}/s", labels=joints),
        )
        self._postures: list[Array] = [np.array(in_order(posture, joints), dtype=float) for posture in config.postures]
        self._near, self._rest = np.array(in_order(config.near, joints), dtype=float), config.rest
        self._next = 0
        self._left = config.rest  # s of rest before it goes to the next posture
        self._going = False
        self._arrivals = 0

    def reset(self) -> None:
        q = self.output["q"]
        q[:] = self.applied.get("q", q)
        self.output["q_velocity"][:] = 0.0
        self._left, self._going = self._rest, False

    def update(self, dt: float) -> None:
        goal = self._postures[self._next]
        if self._going:
            self.output["q"][:] = goal
            # False also where a position isn't a number.
            if not (np.abs(self.input["position"] - goal) <= self._near).all():
                return
            self._next = (self._next + 1) % len(self._postures)
            self._arrivals += 1
            self._left, self._going = self._rest, False
        self._left -= dt
        self._going = self._left <= 0.0

    def metrics(self) -> dict[str, object]:
        """Returns arrivals: how often a posture was reached."""
        return {"arrivals": self._arrivals}
