"""Each rule for laws and for parts is put to one that breaks it; the same one without the fault breaks none."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part
from srl.testing import ControllerConformance, PartConformance, bound

COUNT = itertools.count(1)


class Follow(Controller):
    """The output follows the input from wherever both were; `fault` says what is wrong with it."""

    fault = ""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        labels = () if self.fault == "no names" else ("a", "b")
        self.inputs = (Signal(name="x", shape=(2,), unit="rad", labels=("a", "b")),)
        self.outputs = (Signal(name="q", shape=(2,), unit="rad", labels=labels),)
        self.offset = np.zeros(2)
        self.number, self.cycles = next(COUNT), 0

    def reset(self) -> None:
        self.offset = self.applied["q"] - self.input["x"]
        if self.fault != "remembers the run before":
            self.cycles = 0

    def update(self, dt: float) -> None:
        self.cycles += 1
        self.output["q"][:] = self.input["x"] + (0.0 if self.fault == "jumps" else self.offset)
        if self.fault == "blows up" and self.cycles > 50:
            self.output["q"][0] = np.inf
        if self.fault == "keeps a NaN":
            self.offset = self.offset + 0.0 * self.input["x"]
        if self.fault == "remembers the run before":
            self.output["q"][0] += 1e-9 * self.cycles
        if self.fault == "each is another":
            self.output["q"][0] += 1e-9 * self.number
        if self.fault == "has an output of its own" and dt > 1e-6:
            self.output = {"q": self.output["q"].copy()}
        if self.fault == "writes its input" and dt > 1e-6:
            self.input["x"][0] = 0.0
        if self.fault == "writes what was applied" and dt > 1e-6:
            self.applied["q"][0] = 0.0


class Law(ControllerConformance):
    inputs, start = {"x": [0.3, -0.2]}, {"q": [0.1, 0.2]}

    def __init__(self, fault: str) -> None:
        self.fault = fault

    def law(self) -> Controller:
        cls = type("Follow", (Follow,), {"fault": self.fault})
        return bound(cls("law", ControllerConfig()))


LAW_FAULTS = [
    ("test_it_names_its_elements", "no names", "declares neither"),
    ("test_it_starts_where_the_limb_is", "jumps", "jumps by 0.4 at its reset"),
    ("test_it_stays_finite", "blows up", "isn't finite for finite inputs"),
    ("test_it_recovers_from_nan", "keeps a NaN", "after its input 'x' was NaN for 20 cycles: a NaN is kept"),
    ("test_it_repeats_exactly", "remembers the run before", "after a reset"),
    ("test_it_repeats_exactly", "each is another", "a second one"),
    ("test_it_writes_only_its_outputs", "has an output of its own", "in the place of self.output"),
    ("test_it_writes_only_its_outputs", "writes its input", "changed its input 'x'"),
    ("test_it_writes_only_its_outputs", "writes what was applied", "changed its applied 'q'"),
]


class Pendulum(Part):
    """A pendulum with a motor that remembers something; `fault` says what is wrong with it."""

    fault = ""

    def __init__(self, name: str, config: Any, seed: int) -> None:
        super().__init__(name, config, seed)
        self.every, self.torque = 1, 0.0
        truth = "angle" if self.fault == "truth of no name" else f"{name}_angle"
        size = 2 if self.fault == "truth without elements" else 1
        self.truth = (Signal(name=truth, shape=(size,), unit="rad"),)
        self.chance = np.random.default_rng(None if self.fault == "chance" else seed)

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        base = mjcf.body(parent, f"{self.name}/base", **self.at())
        rod = mjcf.body(base, "rod" if self.fault == "body of no name" else f"{self.name}/rod")
        add(rod, "joint", name=f"{self.name}/joint", axis="0 1 0")
        add(rod, "geom", type="capsule", fromto=(0.0, 0.0, 0.0, 0.0, 0.0, -0.3), size=0.01, mass=1.0, contype=0)

    def bind(self, model: Any, data: Any) -> None:
        joint = model.joint(f"{self.name}/joint")
        self.address, self.dof, self.data = joint.qposadr[0], joint.dofadr[0], data

    def drive(self, step: int) -> None:
        self.torque = 0.99 * self.torque + 0.01 * self.chance.random() * (self.fault == "chance") + 0.001
        self.data.qfrc_applied[self.dof] = 1e12 if self.fault == "blows up" else self.torque

    def fill(self, truth: Mapping[str, Array]) -> None:
        if self.fault != "truth left empty":
            for values in (values for name, values in truth.items() if name.endswith("angle")):
                values[:] = self.data.qpos[self.address]

    def save(self) -> Array:
        return np.empty(0) if self.fault == "forgets" else np.array([self.torque])

    def restore(self, state: Array) -> None:
        if state.size:
            self.torque = state[0]


PART_FAULTS = [
    ("test_it_names_its_truth", "truth without elements", "declares neither"),
    ("test_it_keeps_its_names_apart", "truth of no name", "must begin with 'tested_'"),
    ("test_it_keeps_its_names_apart", "body of no name", "must begin with 'tested/'"),
    ("test_it_fills_its_truth", "truth left empty", "wasn't filled"),
    ("test_it_stays_finite", "blows up", "MuJoCo"),
    ("test_it_repeats_exactly", "chance", "gives other bits"),
    ("test_it_restores_exactly", "forgets", "`save` lacks something"),
]


@pytest.fixture
def pendulum(monkeypatch: pytest.MonkeyPatch) -> PartConformance:
    known = registry.load
    monkeypatch.setattr(
        registry, "load", lambda g, n, p: Pendulum if (g, n) == ("parts", "pendulum") else known(g, n, p)
    )
    made = PartConformance()
    made.part = "pendulum"
    return made


def rules(suite: type) -> list[str]:
    return [name for name in vars(suite) if name.startswith("test_")]


@pytest.mark.parametrize(
    ("suite", "faults"), [(ControllerConformance, LAW_FAULTS), (PartConformance, PART_FAULTS)], ids=["law", "part"]
)
def test_every_rule_is_broken_by_one_of_these(suite: type, faults: list[tuple[str, str, str]]) -> None:
    assert {rule for rule, _, _ in faults} == set(rules(suite))


@pytest.mark.parametrize("rule", rules(ControllerConformance))
def test_a_good_law_keeps_it(rule: str) -> None:
    getattr(Law(""), rule)()


@pytest.mark.parametrize(("rule", "fault", "words"), LAW_FAULTS)
def test_a_law_that_breaks_it_is_caught(rule: str, fault: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        getattr(Law(fault), rule)()


@pytest.mark.parametrize("rule", rules(PartConformance))
def test_a_good_part_keeps_it(rule: str, pendulum: PartConformance) -> None:
    getattr(pendulum, rule)()


@pytest.mark.parametrize(("rule", "fault", "words"), PART_FAULTS)
def test_a_part_that_breaks_it_is_caught(
    rule: str, fault: str, words: str, pendulum: PartConformance, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pendulum, "fault", fault)
    with pytest.raises(AssertionError, match=words):
        getattr(pendulum, rule)()
