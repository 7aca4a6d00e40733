"""What was sent: in the row, in the guard of the next cycle, in the replay, and where a start begins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import toy
from helpers.toy import JOINTS, PROFILE, SPEED, Bench, Law, Toy, ToyConfig, _load

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Command, Kind, Signal, Stop
from srl.runtime.guard import TorqueGuard
from srl.runtime.ipc.header import FLAG_RESYNCHRONISED, Cause, State
from srl.runtime.loop import device as device_module
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.replay import perturbed, replay
from srl.runtime.profile import profile, wiring


def _follow(b: Bench, stalls: tuple[int, int], k: int) -> None:
    """The hand goes to and fro; the arm's link takes nothing from one cycle to the other."""
    b.hand.values["position"][:] = 1.2 * np.sin(0.05 * k)
    b.arm.stalled = stalls[0] <= k < stalls[1]


def _value(b: Bench, name: str) -> Any:
    return b.graph.layout.value(b.rows(), name)


def test_the_row_shows_a_stall_and_what_follows_is_a_ramp(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(300, lambda k: _follow(b, (100, 190), k))
    sent, applied = _value(b, "arm.command.sent")[:, 0], _value(b, "arm.command.applied")[:, 0]
    resynchronised = (b.header("flags") & FLAG_RESYNCHRONISED) > 0
    assert (sent[100:190] == sent[99]).all()
    assert np.abs(np.diff(sent[50:])).max() <= SPEED * 0.01 * (1 + 1e-6)
    assert abs(sent[190] - sent[99]) <= 10 * 0.01**2, "the first step after the stall is one from rest"
    assert np.abs(applied[110:190] - sent[99]).max() <= 10 * 0.01**2, "the guard stays where the arm is"
    assert resynchronised[110:190].all()
    assert not resynchronised[:100].any()
    assert not resynchronised[192:].any()
    reported = [event for event in b.events if "arm.command" in event]
    assert [("again" in event) for event in reported] == [False, True], "and people are told, once each"
    commands = b.header("arm.commands")
    assert commands[189] == commands[99]
    assert commands[299] - commands[189] == 110


def test_before_the_first_command_nothing_is_sent(tmp_path: Path) -> None:
    b = Bench(tmp_path, automatic=False)
    b.run(30, lambda k: b.ask("start") if k == 10 else None)
    sent = _value(b, "arm.command.sent")
    assert np.isnan(sent[:10]).all()
    assert np.isfinite(sent[12:]).all()


def test_a_stall_replays_and_a_perturbed_value_doesnt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "load", _load)
    b = Bench(tmp_path)
    b.run(300, lambda k: _follow(b, (100, 190), k))
    rows = b.rows()[:-1]
    assert replay(b.graph.layout, rows, "toy").identical
    changed = replay(b.graph.layout, perturbed(b.graph.layout, rows, "arm.command.sent:60:-1e-3"), "toy")
    assert changed.largest > 0
    assert not changed.identical


def test_a_driver_that_reports_nothing_as_sent_stops_the_limb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = Bench(tmp_path)
    monkeypatch.setattr(type(b.arm), "publishes", False)
    b.run(260, lambda k: _follow(b, (0, 0), k))
    assert np.ptp(_value(b, "arm.command.applied")[:, 0]) <= 10 * 0.01**2 * 6**2, "it never gets far from its start"
    assert b.states[-1][1] is Cause.DRIVER_ERROR
    assert any("reports no command as sent" in event for event in b.events)


def test_without_feedback_a_start_begins_at_what_was_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard may have gone on by some cycles when a loss is seen: the servo hasn't."""
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    b = Bench(tmp_path, arm="servo")
    first: list[Any] = []

    def script(k: int) -> None:
        b.hand.values["position"][:] = -1.5
        b.arm.stalled = 60 <= k < 64
        b.arm.gone = 64 <= k < 80
        if k == 90:
            b.until_back(b.arm)
            first.append(len(b.arm.sent))
        if k == 95:
            b.ask("reset")

    b.run(160, script)
    index = first[0]
    assert b.states[-1][0] in (State.HOMING, State.ACTIVE)
    step = np.abs(b.arm.sent[index] - b.arm.sent[index - 1])
    assert (step <= 10 * 0.01**2).all()
    assert np.abs(np.diff(np.array(b.arm.sent), axis=0)).max() <= SPEED * 0.01 * (1 + 1e-6)


def _replaced(arm: Any) -> None:
    arm.sent_arrays["command"] = arm.command_arrays["command"]


def _misshaped(arm: Any) -> None:
    arm.sent_arrays["command"] = np.zeros(3)


def _forgotten(arm: Any) -> None:
    arm.sent_arrays = {}


def _misnamed(arm: Any) -> None:
    arm.sent_arrays["comand"][:] = arm.command_arrays["command"]


def _scribbled(arm: Any) -> None:
    np.clip(arm.command_arrays["command"], -0.1, 0.1, out=arm.command_arrays["command"])


def _arrays_of_its_own(arm: Any) -> None:
    arm.state_arrays = {name: array.copy() for name, array in arm.state_arrays.items()}


def _commands_of_its_own(arm: Any) -> None:
    arm.command_arrays = {name: array.copy() for name, array in arm.command_arrays.items()}


@pytest.mark.parametrize(
    "defect",
    [
        _replaced, _misshaped, _forgotten, _misnamed, _scribbled,
        _arrays_of_its_own, _commands_of_its_own,
    ],
)  # fmt: skip
def test_a_driver_that_reports_wrongly_stops_the_limb_and_not_the_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, defect: Any
) -> None:
    write = Toy.write

    def wrong(arm: Toy, now: int) -> None:
        write(arm, now)
        if len(arm.sent) > 50:
            defect(arm)

    monkeypatch.setattr(Toy, "write", wrong)
    b = Bench(tmp_path)
    b.run(120, lambda k: _follow(b, (0, 0), k))
    assert b.states[-1][1] is Cause.DRIVER_ERROR
    assert np.isfinite(_value(b, "arm.command.applied")).all()
    # What it sent and didn't report may be taken back: at most what five periods made.
    assert np.abs(np.diff(np.array(b.arm.sent), axis=0)).max() <= SPEED * 0.05


def test_a_start_without_feedback_is_never_where_nothing_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A servo whose driver reports degrees was sent to 40 rad after a loss. Now that is a fault of the device, too."""
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    write = Toy.write

    def wrong(arm: Toy, now: int) -> None:
        write(arm, now)
        arm.sent_arrays["command"][:] = np.degrees(arm.command_arrays["command"])

    monkeypatch.setattr(Toy, "write", wrong)
    b = Bench(tmp_path, arm="servo")

    def script(k: int) -> None:
        b.arm.gone = 64 <= k < 80
        if k == 90:
            b.until_back(b.arm)
        if k == 95:
            b.ask("reset")

    b.run(160, script)
    assert b.states[-1] == (State.STOPPED, Cause.DEVICE_FAULT)
    assert any("which can't have been" in text for text in b.events)
    assert np.abs(np.diff(np.array(b.arm.sent), axis=0)).max() <= SPEED * 0.01 * (1 + 1e-6)


class Slow(Toy):
    """An arm of two axes with a command each; the second one takes every third."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if name == "arm":
            axis = Command(
                name="first", shape=(2,), unit="rad/s", labels=JOINTS, kind=Kind.VELOCITY, feedback="position",
                stops=(Stop.BRAKE,), period=0.04,
            )  # fmt: skip
            self.commands = (axis, replace(axis, name="second"))
            self.home = {}

    def write(self, now: int) -> None:
        self.recoveries += 1
        for name in ("first", "second") if self.recoveries % 3 == 0 else ("first",):
            self.sent_arrays[name][:] = self.command_arrays[name]


class Both(Law):
    """A first-order law to 0.3 rad/s of 0.1 s for both, from what was applied."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = tuple(Signal(name=n, shape=(2,), unit="rad/s", labels=JOINTS) for n in ("first", "second"))

    def update(self, dt: float) -> None:
        for name, output in self.output.items():
            output[:] = self.applied[name] + (0.3 - self.applied[name]) * dt / 0.1


def test_a_command_isnt_taken_for_sent_because_another_of_its_device_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its law was slowed from 0.1 to 0.2 s: a naive feedback of what was sent."""
    text = PROFILE.replace("out: {{q: arm.command}}", "out: {{first: arm.first, second: arm.second}}").replace(
        "guard: {{arm.command: {{lower: -2, upper: 2, velocity: {speed}, acceleration: 10}}}}",
        "guard: {{arm.first: {{velocity: 1, acceleration: 10}}, arm.second: {{velocity: 1, acceleration: 10}}}}",
    )
    monkeypatch.setattr(toy, "PROFILE", text)
    for module, name in ((toy, "_load"), (registry, "load")):
        monkeypatch.setattr(module, name, lambda group, *_: {"drivers": Slow, "controllers": Both}[group])
    b = Bench(tmp_path)
    b.run(60, lambda k: None)
    assert replay(b.graph.layout, b.rows()[:-1], "toy").identical
    assert np.array_equal(_value(b, "arm.first.applied"), _value(b, "arm.second.applied"))
    assert not (b.header("flags") & FLAG_RESYNCHRONISED).any()


class Weigher(Law):
    """Gives a torque and the gravity compensation that it contains."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.outputs = (*(Signal(name=n, shape=(2,), unit="N m", labels=JOINTS) for n in ("tau", "g")),)

    def update(self, dt: float) -> None:
        self.output["g"][:] = 3.0
        self.output["tau"][:] = 3.0


class TorqueArm(Toy):
    """An arm whose weight its commands must carry."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if name == "arm":
            self.states = tuple(Signal(name=n, shape=(2,), unit="rad", labels=JOINTS) for n in ("position", "velocity"))
            self.values = {s.name: np.zeros(2) for s in self.states}
            self.commands = (
                Command(
                    name="command", shape=(2,), unit="N m", labels=JOINTS, kind=Kind.TORQUE, feedback="position",
                    stops=(Stop.DAMP,), period=0.02,
                ),
            )  # fmt: skip


_TORQUE = (
    PROFILE.replace("out: {{q: arm.command}}", "out: {{tau: arm.command, g: {gravity}}}")
    .replace("lower: -2, upper: 2, velocity: {speed}", "effort: 10, effort_rate: 1000, inertia: 1, velocity: {speed}")
    .format(arm="arm", speed=1.0, emergency="", more="", gravity="{gravity}")
)


def _torque_profile(monkeypatch: pytest.MonkeyPatch, gravity: str) -> Any:
    monkeypatch.setattr(registry, "load", lambda group, *_: {"drivers": TorqueArm, "controllers": Weigher}[group])
    return wiring.build(*profile.parse("toy.yaml", _TORQUE.replace("{gravity}", gravity)))


def test_the_guard_knows_the_gravity_that_a_torque_contains(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = _torque_profile(monkeypatch, "arm.command.gravity")
    cycle = Cycle(graph, limits_of(graph), automatic=True)
    (guard,) = cycle.guards
    assert isinstance(guard, TorqueGuard)
    graph.row.views["arm.command.gravity"][:] = 3.0
    guard.reset(np.zeros(2))
    assert guard.applied.tolist() == [3.0, 3.0], "it starts at gravity compensation"
    for _ in range(50):
        guard.stop(Stop.DAMP, 0.01)
    assert guard.applied.tolist() == [3.0, 3.0], "and a stop keeps it"


def test_gravity_belongs_to_a_torque(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WiringError, match=r"'arm\.command\.velocity' isn't a command.*\n?.*arm\.command\.gravity"):
        _torque_profile(monkeypatch, "arm.command.velocity")


class PulledArm(TorqueArm):
    """It can be held, and stays where a hand puts it."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        self.commands = tuple(replace(command, stops=(Stop.HOLD, Stop.DAMP)) for command in self.commands)

    def write(self, now: int) -> None:
        self.sent_arrays["command"][:] = self.command_arrays["command"]


def test_a_start_does_not_drop_the_torque_that_a_held_stop_pulls_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = _TORQUE.replace("{gravity}", "arm.command.gravity").replace("effort_rate: 1000", "effort_rate: 50")
    text = text.replace("bus: null", "bus: null\nstop: {arm: hold}")
    monkeypatch.setattr(toy, "PROFILE", text.replace("{", "{{").replace("}", "}}"))  # it is formatted again
    for module, name in ((toy, "_load"), (registry, "load")):
        monkeypatch.setattr(module, name, lambda group, *_: {"drivers": PulledArm, "controllers": Weigher}[group])
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 30:
            b.ask("stop")
        elif k == 60:
            b.arm.values["position"][:] = 0.4  # rad: a hand pulls
        elif k == 90:
            b.ask("reset")

    b.run(130, script)
    states, applied = b.header("state"), _value(b, "arm.command.applied")
    assert State.STOPPED in states[30:90]
    assert states[-2] == State.ACTIVE
    assert np.abs(applied[85:90] - 3.0).max() > 2.0, "the hold pulls back"
    started = int(np.flatnonzero(states == State.ACTIVE)[0])
    assert np.abs(np.diff(applied[started:], axis=0)).max() <= 50 * 0.01 * (1 + 1e-9)
