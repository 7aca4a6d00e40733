"""Faults, requests and stale samples in any order against Cycle, Device and Loop, with a toy arm and no hardware."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime import device as device_module
from runtime import profile, registry, wiring
from runtime.clock import Clock, Tick
from runtime.controller import Controller, ControllerConfig
from runtime.cycle import Cycle, limits_of
from runtime.device import Device
from runtime.driver import DeviceConfig, Driver
from runtime.errors import DeviceError, DeviceLostError
from runtime.graph import Graph
from runtime.inbox import Inbox
from runtime.layout import LINK_ACTIVE, LINK_CONNECTED, Cause, State
from runtime.loop import Loop
from runtime.loop_process import _plain
from runtime.mailbox import Ask, MailboxWriter
from runtime.replay import replay
from runtime.ring import RingReader, RingWriter
from runtime.rundir import RunDir
from runtime.signals import Array, Command, Kind, Signal, Stop

PERIOD = 10_000_000  # ns
SPEED = 1.0  # rad/s, the guard's limit

PROFILE = """
name: toy
rate: 100
devices:
  hand: {{driver: toy, part: hand}}
  arm: {{driver: toy, part: {arm}}}
  panel: {{driver: toy, part: panel}}
controllers:
  - {{use: law, in: {{x: hand.position}}, out: {{q: arm.command}}}}
guard: {{arm.command: {{lower: -2, upper: 2, velocity: {speed}, acceleration: 10}}}}
emergency: [{emergency}]
bus: null
{more}
"""


class ToyConfig(DeviceConfig):
    part: str


class Toy(Driver):
    """A hand, a panel of four buttons, an arm that measures what it was told, or a servo that measures nothing."""

    Config = ToyConfig
    max_age = 0.05

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        self.sent: list[Array] = []
        self.recoveries = 0
        self.gone = self.silent = self.gone_in_write = False
        self.defect: Exception | None = None
        part = config.part
        position = Signal(name="position", shape=(2,), unit="rad")
        if part == "panel":
            self.states = (Signal(name="buttons", shape=(4,), unit="1"),)
        elif part != "servo":
            self.states = (position,)
        if part in ("arm", "servo"):
            feedback = "position" if part == "arm" else None
            stops = (Stop.HOLD, Stop.RETRACT, Stop.LIMP)
            self.commands = (
                Command(name="command", shape=(2,), unit="rad", kind=Kind.POSITION, feedback=feedback, stops=stops),
            )
            self.home = {"command": np.full(2, 0.7)}
        self.values = {s.name: np.zeros(s.shape) for s in self.states}

    def open(self) -> None:
        if self.gone:
            raise DeviceError(self.name, "it is away", "Plug it in")
        self.health.connected = True

    def read(self, now: int) -> None:
        if self.gone:
            raise DeviceLostError(self.name, "it is away", "Plug it in")
        if not self.silent:
            self.health.stamp = now
        for name, value in self.values.items():
            self.state_arrays[name][:] = value

    def write(self, now: int) -> None:
        if self.gone_in_write:
            self.gone_in_write = self.health.connected = False
            raise DeviceLostError(self.name, "it went away", "Plug it in")
        if self.defect is not None:
            raise self.defect
        self.sent.append(self.command_arrays["command"].copy())
        if "position" in self.values:
            self.values["position"][:] = self.sent[-1]

    def stop(self, category: Stop) -> None: ...

    def recover(self, now: int) -> None:
        self.recoveries += 1

    def close(self) -> None:
        self.health.connected = False


class Law(Controller):
    """Copies."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="x", shape=(2,), unit="rad"),)
        self.outputs = (Signal(name="q", shape=(2,), unit="rad"),)

    def reset(self) -> None: ...

    def update(self, dt: float) -> None:
        self.output["q"][:] = self.input["x"]


def _load(group: str, name: str, place: str) -> Any:
    return {"drivers": Toy, "controllers": Law}[group]


ESTOPS = ", ".join(f"{{signal: panel.buttons, index: {i}}}" for i in range(4))


def wired(arm: str = "arm", emergency: str = ESTOPS, more: str = "") -> Graph:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "load", _load)
        text = PROFILE.format(arm=arm, speed=SPEED, emergency=emergency, more=more)
        return wiring.build(*profile.parse("toy.yaml", text))


class Bench:
    """A whole loop on a clock of the test's own; `script` is called before each cycle with its number."""

    def __init__(self, folder: Path, automatic: bool = True, **options: Any) -> None:
        graph = self.graph = wired(**options)
        self.notes: list[str] = []
        devices = [Device(d, i, graph.board, self.notes.append) for i, d in enumerate(graph.devices)]
        self.hand, self.arm, self.panel = (d.driver for d in devices)
        for d in devices:
            d.driver.open()
            d.watch()
        self.rundir = RunDir(folder)
        MailboxWriter.create(self.rundir.mail)
        ring = RingWriter.create(self.rundir.rows, graph.layout.width, 4096)
        limits = limits_of(graph)
        meta = graph.layout.meta
        meta["limits"] = {n: _plain(v) for n, v in limits.items()}
        meta["automatic"], meta["crashed"] = automatic, False
        self.cycle = Cycle(graph, limits, automatic, note=self.notes.append)
        self.states: list[tuple[State, Cause]] = []
        bench = self

        class Steps(Clock):
            def start(self) -> None:
                self.count = 0
                self.tick.now = 1_000_000_000

            def wait(self) -> Tick:
                tick = self.tick
                tick.now, tick.dt, tick.missed = tick.now + PERIOD, PERIOD, 0
                bench.states.append((bench.cycle.machine.state, bench.cycle.machine.cause))
                if self.count >= bench.cycles:
                    bench.cycle.machine.state = State.ENDED
                bench.script(self.count)
                self.count += 1
                return tick

        self.loop = Loop(graph, devices, Steps(Fraction(100)), self.cycle, Inbox(self.rundir, graph), ring)

    def run(self, cycles: int, script: Callable[[int], None]) -> Bench:
        self.cycles, self.script = cycles, script
        self.loop.run()
        return self

    def ask(self, what: str, **more: str) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asker:
            asker.bind("")
            asker.sendto(json.dumps({"ask": what} | more).encode(), str(self.rundir.loop_socket))

    def until_back(self, driver: Driver) -> None:
        """Waits until the thread that opens it again is done."""
        end = time.monotonic() + 5
        while not driver.health.connected and time.monotonic() < end:
            time.sleep(0.001)
        time.sleep(0.05)

    def rows(self) -> Any:
        return RingReader(self.rundir.rows).take()

    def word(self, name: str) -> Any:
        return self.graph.layout.word(self.rows(), name)


# Any order of events


step = st.fixed_dictionaries(
    {
        "ask": st.sampled_from([Ask.NONE] * 6 + [Ask.START, Ask.RESET, Ask.RESET, Ask.STOP, Ask.FAULT, Ask.EXIT]),
        "target": st.sampled_from([Cause.NONE, Cause.BUS_LOSS, Cause.OVERRUN]),
        "stale": st.sampled_from([""] * 5 + ["hand", "arm", "panel"]),
        "lost": st.sampled_from([""] * 6 + ["hand", "arm"]),
        "button": st.sampled_from([0.0] * 6 + [1.0]),
        "x": st.sampled_from([0.0, 0.5, -3.0, 1.9, np.nan, np.inf, 1e300]),
        "periods": st.sampled_from([1] * 8 + [2, 7, 40]),
        "times": st.integers(1, 30),
    }
)


def _cycles(steps: list[dict[str, Any]], automatic: bool) -> Any:
    """Runs them; yields what each cycle began with and ended with."""
    graph = wired(emergency="{signal: panel.buttons, index: 0, category: retract}")
    cycle = Cycle(graph, limits_of(graph), automatic)
    ints, index, views = graph.board.ints, graph.board.index, graph.board.views
    applied, measured = views["arm.command.applied"], views["arm.position"]
    now, link = 1_000_000_000, index["arm.link"]
    stamps = dict.fromkeys(("hand", "arm", "panel"), now)
    for s in steps:
        for k in range(s["times"]):
            now += s["periods"] * PERIOD
            ints[index["now"]], ints[index["dt"]] = now, s["periods"] * PERIOD
            for name in stamps:
                stamps[name] = stamps[name] if name == s["stale"] else now
                word = index[f"{name}.link"]
                connected = LINK_CONNECTED * (name != s["lost"])
                ints[index[f"{name}.stamp"]], ints[word] = (
                    stamps[name],
                    (int(ints[word]) & LINK_ACTIVE) | connected,
                )
            views["panel.buttons"][0], views["hand.position"][:] = s["button"], s["x"]
            before, was = applied.copy(), cycle.machine.state
            ask = s["ask"] if k == 0 else Ask.NONE
            cycle.check(s["periods"] - 1, ask, int(s["target"]))
            present = cycle._fault
            cycle.control()
            cycle.guard()
            state, active = cycle.machine.state, bool(ints[link] & LINK_ACTIVE)
            yield SimpleNamespace(
                was=was, state=state, ask=ask, present=present, active=active, before=before,
                applied=applied.copy(), measured=measured.copy(), dt=min(s["periods"], 5) * PERIOD * 1e-9,
                connected=bool(ints[link] & LINK_CONNECTED),
            )  # fmt: skip
            if active:
                measured[:] = applied  # the arm is where it was told to be
            if state is State.ENDED:
                return


@settings(max_examples=150, deadline=None)
@given(steps=st.lists(step, min_size=1, max_size=12), automatic=st.booleans())
def test_no_order_of_events_steps_or_moves_unasked(steps: list[dict[str, Any]], automatic: bool) -> None:
    for c in _cycles(steps, automatic):
        assert np.isfinite(c.applied).all()
        assert (np.abs(c.applied) <= 2 + 1e-9).all()
        assert (np.abs(c.applied - c.before) <= SPEED * c.dt * (1 + 1e-6) + 1e-9).all()
        assert c.state is not State.READY or not c.active
        assert c.state is not State.ACTIVE or c.present is None
        began = c.was in (State.READY, State.STOPPED) and c.state in (State.HOMING, State.ACTIVE)
        asked = c.ask is (Ask.START if c.was is State.READY else Ask.RESET)
        assert not began or (asked or (automatic and c.was is State.READY))
        assert not began or c.present is None


@settings(max_examples=30, deadline=None)
@given(steps=st.lists(step, min_size=1, max_size=8))
def test_after_the_end_nothing_changes(steps: list[dict[str, Any]]) -> None:
    graph = wired()
    cycle = Cycle(graph, limits_of(graph), True)
    cycle.machine.state, cycle.machine.exiting = State.ENDED, True
    for s in steps:
        cycle.check(s["periods"] - 1, s["ask"], int(s["target"]))
        cycle.control()
        cycle.guard()
        assert cycle.machine.state is State.ENDED


def test_a_stop_begins_in_the_cycle_of_its_fault(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        b.hand.values["position"][:] = 1.5
        if k == 50:
            b.panel.values["buttons"][2] = 1

    b.run(120, script)
    state, sent = b.word("state"), np.array(b.arm.sent)[:, 0]
    assert state[49] == State.ACTIVE
    assert state[50] in (State.STOPPING, State.STOPPED)
    assert abs(np.diff(sent)).max() <= SPEED * 0.01 * (1 + 1e-6)
    assert np.ptp(sent[-20:]) == 0


def test_a_driver_whose_write_fails_stops_the_limb(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.arm.defect = ValueError("a defect")

    b.run(100, script)
    assert b.states[-1][1] is Cause.DRIVER_ERROR


def test_a_device_that_refuses_to_move_stops_the_limb_and_recovers_only_when_told(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    sent_in_fault = 0

    def script(k: int) -> None:
        nonlocal sent_in_fault
        if k == 30:
            b.arm.health.fault = "protective stop"
        if k == 31:
            sent_in_fault = len(b.arm.sent)
        if k == 60:
            assert (b.arm.recoveries, len(b.arm.sent)) == (0, sent_in_fault)
            b.ask("reset")
        if k == 70:
            assert b.arm.recoveries == 1
            b.arm.health.fault = ""
        if k == 80:
            assert b.cycle.machine.state is State.STOPPED
            assert len(b.arm.sent) == sent_in_fault
            b.ask("reset")

    b.run(100, script)
    assert b.word("state")[30] in (State.STOPPING, State.STOPPED)
    assert b.states[50] == (State.STOPPED, Cause.DEVICE_FAULT)
    assert b.states[-1] == (State.ACTIVE, Cause.NONE)
    assert b.arm.recoveries == 1
    assert any("protective stop" in note for note in b.notes)
    assert any("well again" in note for note in b.notes)


def test_a_stop_that_overtakes_a_reset_leaves_it_refused(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(80, _stop_then_both(b))
    assert (b.word("state")[45:] == State.STOPPED)[:-1].all()


def _stop_then_both(b: Bench) -> Callable[[int], None]:
    def script(k: int) -> None:
        if k == 20:
            b.ask("stop")
        if k == 50:
            b.ask("reset")
            b.ask("stop")

    return script


# What is not yet so


def test_a_device_that_came_back_gets_no_command_before_a_reset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    b = Bench(tmp_path)
    sent = []

    def script(k: int) -> None:
        if k == 50:
            b.arm.gone = True
        if k == 80:
            b.arm.gone = False
            sent.append(len(b.arm.sent))
        if k == 90:
            b.until_back(b.arm)

    b.run(160, script)
    assert any("is back" in note for note in b.notes)
    assert len(b.arm.sent) == sent[0]


def test_a_limp_device_whose_write_failed_once_can_be_reset(tmp_path: Path) -> None:
    b = Bench(tmp_path, more="stop: {arm: limp}")

    def script(k: int) -> None:
        b.arm.defect = ValueError("once") if k == 50 else None
        if k == 100:
            b.ask("reset")

    b.run(150, script)
    assert b.states[99][0] is State.STOPPED
    assert b.states[-1][0] is State.ACTIVE


def test_a_loss_in_write_is_seen_however_soon_it_is_back(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.arm.gone_in_write = True
        if k == 51:
            b.until_back(b.arm)

    b.run(100, script)
    assert b.states[-1][1] is Cause.DEVICE_LOSS


def test_a_pressed_stop_button_refuses_the_reset(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.panel.values["buttons"][3] = 1
        if k == 80:
            b.ask("reset")

    b.run(100, script)
    assert {s for s, _ in b.states[60:]} == {State.STOPPED}


def test_a_stop_button_that_is_unplugged_stops_the_limb(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 50:
            b.panel.gone = True

    b.run(100, script)
    assert b.states[-1][0] is State.STOPPED


@pytest.mark.parametrize("what", ["fault", "stop", "exit"])
def test_no_datagram_ends_the_loop(tmp_path: Path, what: str) -> None:
    b = Bench(tmp_path, emergency="")
    b.run(60, lambda k: b.ask(what, cause="emergency") if k == 50 else None)


def test_a_homing_that_was_broken_off_goes_on_without_a_step(tmp_path: Path) -> None:
    """A servo that was lost goes home slowly after the reset; a loss of intent on the way breaks that off."""
    b = Bench(tmp_path, arm="servo", emergency="")
    begun: list[int] = []

    def script(k: int) -> None:
        if k == 100:
            b.arm.gone_in_write = True
        if k == 102:
            b.until_back(b.arm)
            begun.append(len(b.arm.sent))
        if k in (110, 162):
            b.ask("reset")
        if k == 115:
            b.hand.silent = True
        if k == 160:
            b.hand.silent = False

    b.run(300, script)
    assert b.states[105] == (State.STOPPED, Cause.DEVICE_LOSS)
    assert b.states[112][0] is State.HOMING
    assert b.states[150] == (State.STOPPED, Cause.INTENT_LOSS)
    sent = np.array(b.arm.sent)
    assert np.abs(np.diff(sent, axis=0)).max() <= SPEED * 0.01 * (1 + 1e-6)
    assert np.abs(np.diff(sent[begun[0] :][:5], axis=0)).max() <= SPEED * 0.01 / 4 * (1 + 1e-6)


def test_a_reset_that_was_overtaken_replays_as_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = Bench(tmp_path)
    b.run(80, _stop_then_both(b))
    monkeypatch.setattr(registry, "load", _load)
    assert replay(b.graph.layout, b.rows()[:-1], "toy").identical


def test_an_exit_always_ends(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(150, lambda k: b.ask("exit", cause="bus_loss") if k == 50 else None)
    assert len(b.states) < 150


def test_a_guard_knows_that_its_measurements_are_old(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="")
    blind: dict[int, bool] = {}

    def script(k: int) -> None:
        blind[k] = b.cycle.guards[0].blind
        if k == 50:
            b.arm.silent = True

    b.run(80, script)
    assert b.states[75][1] is Cause.DEVICE_LOSS
    assert (blind[50], blind[75]) == (False, True)
