"""Starts of a device that takes several commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import toy
from helpers.toy import JOINTS, PROFILE, Bench, Law, Toy, ToyConfig

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.signals import Command, Kind, Signal, Stop
from srl.runtime.ipc.header import Cause, State
from srl.runtime.loop import device as device_module


def both(outputs: str, limits: str) -> str:
    """The toy's profile with the commands `first` and `second` in place of one."""
    lines = PROFILE.replace("q: arm.command", outputs).splitlines()
    guard = f"guard: {{{{arm.first: {limits}, arm.second: {limits}}}}}"
    return "\n".join(guard if line.startswith("guard:") else line for line in lines)


def value(b: Bench, name: str) -> Any:
    return b.graph.layout.value(b.rows(), name)


class TwinArm(Toy):
    """Two arms of torque on one link, which a command each moves."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if name == "arm":
            self.states = tuple(Signal(name=n, shape=(2,), unit="rad", labels=JOINTS) for n in ("position", "velocity"))
            self.values = {s.name: np.zeros(2) for s in self.states}
            axis = Command(
                name="first", shape=(2,), unit="N m", labels=JOINTS, kind=Kind.TORQUE, feedback="position",
                stops=(Stop.DAMP,), period=0.02,
            )  # fmt: skip
            self.commands = (axis, replace(axis, name="second"))
            self.home = {}

    def write(self, now: int) -> None:
        for name, sent in self.sent_arrays.items():
            sent[:] = self.command_arrays[name]


class Pushers(Law):
    """Pushes with 9 N m in each."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = tuple(Signal(name=n, shape=(2,), unit="N m", labels=JOINTS) for n in ("tau", "other"))

    def update(self, dt: float) -> None:
        for output in self.output.values():
            output[:] = 9.0


def test_no_command_of_a_device_that_was_away_goes_on_from_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The start of its first command makes the device active, which says nothing of how it was led until then."""
    limits = "{{effort: 10, effort_rate: 5, inertia: 1, velocity: 1, acceleration: 10}}"
    monkeypatch.setattr(toy, "PROFILE", both("tau: arm.first, other: arm.second", limits))
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    for module, name in ((toy, "_load"), (registry, "load")):
        monkeypatch.setattr(module, name, lambda group, *_: {"drivers": TwinArm, "controllers": Pushers}[group])
    b = Bench(tmp_path)

    def script(k: int) -> None:
        b.arm.gone = 100 <= k < 120
        if k == 130:
            b.until_back(b.arm)
        if k == 135:
            b.ask("reset")

    b.run(150, script)
    states = b.header("state")
    start = 135 + int(np.flatnonzero(states[135:] == State.ACTIVE)[0])
    for name in ("first", "second"):
        applied = value(b, f"arm.{name}.applied")
        assert applied[99].min() > 4.0
        assert applied[start].max() <= 5 * 0.01 * 3, name


class HalfBlind(Toy):
    """Two arms on one link, each with a command and its own feedback; the second one measures nothing."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if name == "arm":
            (position,) = self.states
            (command,) = self.commands
            self.states = (position, replace(position, name="other"))
            self.values = {"position": np.zeros(2), "other": np.full(2, np.nan)}
            self.commands = (replace(command, name="first"), replace(command, name="second", feedback="other"))
            self.home = {}

    def write(self, now: int) -> None:
        for name, sent in self.sent_arrays.items():
            sent[:] = self.command_arrays[name]


class Still(Law):
    """Two commands of zero."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = tuple(Signal(name=n, shape=(2,), unit="rad", labels=JOINTS) for n in ("first", "second"))

    def update(self, dt: float) -> None: ...


def test_a_device_of_which_one_command_cannot_start_gets_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = "{{lower: -2, upper: 2, velocity: 1, acceleration: 10}}"
    monkeypatch.setattr(toy, "PROFILE", both("first: arm.first, second: arm.second", limits))
    for module, name in ((toy, "_load"), (registry, "load")):
        monkeypatch.setattr(module, name, lambda group, *_: {"drivers": HalfBlind, "controllers": Still}[group])
    b = Bench(tmp_path)
    b.run(40, lambda k: None)
    assert b.states[-1] == (State.STOPPED, Cause.DRIVER_ERROR)
    assert np.isnan(value(b, "arm.first.sent")).all()
    assert np.isnan(value(b, "arm.second.sent")).all()
