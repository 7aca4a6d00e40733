"""A command that isn't finite: the guard holds the limb, and an event says which law asks it, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import pytest

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import FORCE
from srl.runtime.ipc.header import CYCLE
from srl.runtime.loop.monitors import RejectedCommands
from srl.testing import Lab

JOINTS = ("proximal", "distal")
PROFILE = """
name: spring-finger
rate: 100
bus: null
devices:
  finger:
    driver: dynamixel
    port: /dev/ttyUSB0
    motors:
      proximal: {id: 1, model: MX-28, lower: -1.2, upper: 1.2}
      distal: {id: 2, model: MX-28, lower: -1.2, upper: 1.2}
  sensor: {driver: ati-netft, port: udp://192.168.1.1, bias: true}
controllers:
  - {use: spring, in: {force: sensor.wrench}, out: {q: finger.position_command}}
guard: {finger.position_command: {velocity: 1.0, acceleration: 5.0}}
stop: {finger: hold}
sim:
  world: cell
  parts:
    finger: {part: dynamixel-chain, axes: {proximal: {model: MX-28}, distal: {model: MX-28}}}
    plate: {part: ft-sensor, at: finger/tip}
    grip: {part: handle, at: plate/tool}
"""


class Spring(Controller):
    """The joints yield to the force. Without `keeps`, a NaN leaves nothing behind."""

    keeps: ClassVar[bool] = True

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="force", shape=(3,), unit="N", labels=FORCE),)
        self.outputs = (Signal(name="q", shape=(2,), unit="rad", labels=JOINTS),)
        self.start, self.deviation = np.zeros(2), np.zeros(2)

    def reset(self) -> None:
        self.start, self.deviation = self.applied["q"].copy(), np.zeros(2)
        self.output["q"][:] = self.start

    def update(self, dt: float) -> None:
        kept = self.deviation if self.keeps else np.nan_to_num(self.deviation)
        self.deviation = kept + dt / 0.3 * (0.01 * self.input["force"][1] - kept)
        self.output["q"][:] = self.start + self.deviation


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    known = registry.load
    monkeypatch.setattr(registry, "load", lambda g, n, p: Spring if n == "spring" else known(g, n, p))
    with Lab(PROFILE) as run:
        run.until("active")
        run.run(0.5)
        yield run


def rejections(run: Lab) -> list[str]:
    return [text for text in run.events if "is rejected" in text]


def test_a_law_that_keeps_a_nan_is_named_once_until_it_is_reset(lab: Lab) -> None:
    lab.fault("sensor", "nan")
    lab.run(0.1)
    lab.heal("sensor")
    lab.run(0.1)
    assert rejections(lab) == []
    lab.run(3.0)
    assert lab.state == "active"
    (said,) = rejections(lab)
    assert said.startswith("'finger.position_command' is rejected and its limb held: its controller 'spring' asks")
    assert "though its inputs are: it keeps a NaN" in said
    lab.stop()
    lab.until("stopped")
    lab.reset()
    lab.until("active")
    lab.run(1.0)
    assert len(rejections(lab)) == 1
    assert np.isfinite(lab["finger.position_command"]).all()
    lab.fault("sensor", "nan")
    lab.run(1.0)
    assert len(rejections(lab)) == 2


def test_an_input_that_isnt_known_is_named(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Spring, "keeps", False)
    lab.fault("sensor", "nan")
    lab.run(1.0)
    (said,) = rejections(lab)
    assert "as its input 'force' (sensor.wrench) isn't" in said


def test_what_is_shorter_or_broken_off_is_not_reported(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Spring, "keeps", False)
    for _ in range(5):
        lab.fault("sensor", "nan")
        lab.run(0.2)
        lab.heal("sensor")
        lab.run(0.02)
    assert rejections(lab) == []


def test_a_sensor_that_is_lost_is_reported_as_such_alone(lab: Lab) -> None:
    lab.fault("sensor", "silent")
    lab.until("stopped")
    lab.run(1.0)
    assert lab.cause == "intent_loss"
    assert rejections(lab) == []


def test_nothing_is_asked_while_nothing_is_rejected(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(*_: object) -> None:
        raise AssertionError("it was asked")

    monkeypatch.setattr(RejectedCommands, "update", asked)
    lab.run(1.0)
    lab.fault("sensor", "nan")
    with pytest.raises(AssertionError, match="it was asked"):
        lab.run(0.1)


def test_a_measurement_that_isnt_known_isnt_the_laws(lab: Lab) -> None:
    """A guard rejects then, too; the law may ask what it will."""
    cycle, ints = lab._lockstep.cycle, lab._graph.row.ints
    cycle.guards[0].rejected = True
    for _ in range(100):
        ints[CYCLE.cycle] += 1
        cycle._rejected.update(0.01)
    assert rejections(lab) == []
    lab._graph.row.views["finger.position_command"][:] = np.nan
    for _ in range(100):
        ints[CYCLE.cycle] += 1
        cycle._rejected.update(0.01)
    assert len(rejections(lab)) == 1
