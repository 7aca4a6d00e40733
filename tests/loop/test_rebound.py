"""A law that puts an array of its own in the place of a bound one: the loop would go on with the values of before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np
import pytest

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.testing import Lab

PROFILE = """
name: turner
rate: 100
bus: null
devices:
  finger:
    driver: dynamixel
    port: /dev/ttyUSB0
    motors: {proximal: {id: 1, model: MX-28, lower: -1.2, upper: 1.2}}
controllers:
  - {use: turn, out: {q: finger.position_command}}
guard: {finger.position_command: {velocity: 1.0, acceleration: 5.0}}
stop: {finger: hold}
sim: {world: cell, parts: {finger: {part: dynamixel-chain, axes: {proximal: {model: MX-28}}}}}
"""


class Turn(Controller):
    """It turns for half a second, and then does `wrong`."""

    wrong: ClassVar[str] = ""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = (Signal(name="q", shape=(1,), unit="rad", labels=("proximal",)),)
        self.time = 0.0

    def reset(self) -> None:
        self.output["q"][:] = self.applied["q"]

    def update(self, dt: float) -> None:
        self.time += dt
        if self.time < 0.5:
            self.output["q"] += 0.2 * dt  # type: ignore[index] # the same array
        elif self.wrong == "an item":
            self.output["q"] = np.zeros(1)  # type: ignore[index]
        elif self.wrong == "all":
            outputs: Mapping[str, Array] = {"q": np.zeros(1)}
            self.output = outputs
        elif self.wrong == "its inputs":
            self.input = {}


@pytest.fixture
def lab(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    known, law = registry.load, type("Turn", (Turn,), {"wrong": request.param})
    monkeypatch.setattr(registry, "load", lambda g, n, p: law if n == "turn" else known(g, n, p))
    with Lab(PROFILE) as run:
        run.until("active")
        run.run(0.4)
        yield run


@pytest.mark.parametrize("lab", ["an item", "all", "its inputs"], indirect=True)
def test_it_stops_the_limb_with_its_place(lab: Lab) -> None:
    assert lab.state == "active"
    lab.until("stopped")
    assert lab.cause == "controller_error"
    assert any("controller 'turn' failed" in text for text in lab.events)


@pytest.mark.parametrize("lab", [""], indirect=True)
def test_in_place_is_as_it_should_be(lab: Lab) -> None:
    lab.run(1.0)
    assert lab.state == "active"
