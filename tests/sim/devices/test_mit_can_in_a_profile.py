"""A limb of MIT-mode actuators under the whole loop: follows, stops by its own damping, and starts again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from helpers.toy import Law

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import WiringError
from srl.testing import Lab

PROFILE = """
name: limb
rate: {rate}
setpoints: {{client.position: {{shape: [2], unit: rad, labels: [shoulder, elbow], max_age: 0.05}}}}
devices:
  arm:
    driver: mit-can
    port: can://socketcan/can0
    maker: damiao
    motors:
      shoulder: {{id: 1, model: DM8009, lower: -1.5, upper: 1.5, kp: 80, kd: 2.5}}
      elbow: {{id: 2, model: DM4340, lower: -2.0, upper: 2.0, kp: 40, kd: 2}}
controllers:
  - {{use: law, in: {{x: client.position}}, out: {{q: arm.position_command}}}}
guard: {{arm.position_command: {{velocity: 1.0, acceleration: 5.0}}}}
stop: {{arm: {stop}}}
sim:
  world: cell
  parts:
    arm:
      part: actuator-chain
      axes:
        shoulder: {{model: DM8009, axis: [0, 1, 0], link: [0.25, 0, 0], mass: 0.4}}
        elbow: {{model: DM4340, axis: [0, 1, 0], link: [0.25, 0, 0], mass: 0.4}}
  devices: {{arm: {{{fault}}}}}
"""
Begin = Callable[..., Lab]


@pytest.fixture
def begin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Begin]:
    load = registry.load

    def ours(group: str, name: str, place: str) -> Any:
        return Law if (group, name) == ("controllers", "law") else load(group, name, place)

    monkeypatch.setattr(registry, "load", ours)
    labs: list[Lab] = []

    def made(stop: str = "hold", fault: str = "", rate: int = 500) -> Lab:
        labs.append(Lab(PROFILE.format(stop=stop, fault=fault, rate=rate)))
        return labs[-1]

    yield made
    for lab in labs:
        lab.close()


def active(lab: Lab) -> None:
    lab.setpoint("client.position", [0.0, 0.0])
    lab.step(3)
    lab.start()
    lab.until("active")
    lab.run(0.6)
    assert lab.state == "active", (lab.cause, lab.events)


@pytest.mark.slow
def test_it_follows_what_the_guard_lets_through(begin: Begin) -> None:
    lab = begin()
    active(lab)
    lab.setpoint("client.position", [0.0, 0.4])
    lab.until("arm.position", above=-0.1)
    lab.run(1.0)
    assert lab["arm.position"] == pytest.approx([0.04, 0.41], abs=0.03)
    assert lab["arm.position_command.sent"] == pytest.approx([0.0, 0.4], abs=1e-3)


def test_a_damped_stop_sinks_slowly_and_starts_again_where_it_is(begin: Begin) -> None:
    lab = begin("damp")
    active(lab)
    lab.stop()
    lab.until("stopped")
    before = lab["arm.position"][0]
    fastest = 0.0
    for _ in range(150):
        lab.step()
        fastest = max(fastest, abs(float(lab["arm.velocity"][0])))
    assert 0.2 < fastest < 3.0 / 2.0  # the shoulder's 3.0 N m over its damping
    lab.setpoint("client.position", lab["arm.position"])
    lab.reset()
    lab.until("active")
    lab.run(0.6)
    assert lab["arm.position"][0] > before + 0.1
    assert np.abs(lab["arm.velocity"]).max() < 0.1


def test_one_silent_motor_stops_the_limb_and_the_other_holds(begin: Begin) -> None:
    lab = begin("hold", "silent: {elbow: [[1.0, 9.0]]}")
    active(lab)
    lab.until("stopped", most=1.0)
    assert lab.fault_source == "arm"
    assert lab.time < 1.1
    lab.run(0.3)
    assert lab["world.arm_position"][0] == pytest.approx(0.04, abs=0.03)


def test_a_limb_that_asks_too_much_of_its_bus_is_refused(begin: Begin) -> None:
    with pytest.raises(WiringError, match="can't carry arm at 2000 Hz"):
        begin(rate=2000)
