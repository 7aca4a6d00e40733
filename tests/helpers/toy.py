"""A toy arm, hand and panel without hardware, a law that copies, and a whole loop on a clock of the test's own."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.wait import until
from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Array, Command, Kind, Signal, Stop
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.header import Cause, Latch, State
from srl.runtime.ipc.latches import NONE, names
from srl.runtime.ipc.requests import RequestWriter
from srl.runtime.ipc.ring import RingReader, RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.clock import Clock, Tick
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.loop import Loop
from srl.runtime.loop.process import _plain
from srl.runtime.loop.request_queue import RequestQueue
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph

PERIOD = 10_000_000  # ns


JOINTS = ("shoulder", "elbow")
BUTTONS = ("first", "second", "third", "fourth")

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
    publishes = True  # it reports what it sent

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        self.sent: list[Array] = []
        self.recoveries = 0
        self.gone = self.silent = self.gone_in_write = False
        self.stalled = False  # its link takes nothing
        self.defect: Exception | None = None
        part = config.part
        position = Signal(name="position", shape=(2,), unit="rad", labels=JOINTS)
        if part == "panel":
            self.states = (Signal(name="buttons", shape=(4,), unit="1", labels=BUTTONS),)
        elif part != "servo":
            self.states = (position,)
        if part in ("arm", "servo"):
            feedback = "position" if part == "arm" else None
            stops = (Stop.HOLD, Stop.RETRACT, Stop.LIMP)
            self.commands = (
                Command(
                    name="command",
                    shape=(2,),
                    unit="rad",
                    labels=JOINTS,
                    kind=Kind.POSITION,
                    feedback=feedback,
                    stops=stops,
                    period=0.02,
                ),
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
        if self.stalled:
            return
        self.sent.append(self.command_arrays["command"].copy())
        if self.publishes:
            self.sent_arrays["command"][:] = self.sent[-1]
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
        self.inputs = (Signal(name="x", shape=(2,), unit="rad", labels=JOINTS),)
        self.outputs = (Signal(name="q", shape=(2,), unit="rad", labels=JOINTS),)

    def reset(self) -> None: ...

    def update(self, dt: float) -> None:
        self.output["q"][:] = self.input["x"]


def _load(group: str, name: str, place: str) -> Any:
    return {"drivers": Toy, "controllers": Law}[group]


CLIENT = "setpoints: {client.position: {shape: [2], unit: rad, labels: [shoulder, elbow], max_age: 0.05}}"
ESTOPS = ", ".join(f"{{signal: panel.buttons, element: {name}}}" for name in BUTTONS)


def wired(arm: str = "arm", emergency: str = ESTOPS, more: str = "", client: bool = False) -> Graph:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "load", _load)
        text = PROFILE.format(arm=arm, speed=SPEED, emergency=emergency, more=more)
        if client:  # the law follows a setpoint in place of the hand
            text = text.replace("hand.position", "client.position").replace("bus: null", CLIENT)
        return wiring.build(*profile.parse("toy.yaml", text))


class Bench:
    """A whole loop on a clock of the test's own; `script` is called before each cycle with its number."""

    def __init__(self, folder: Path, automatic: bool = True, latched: Latch = NONE, **options: Any) -> None:
        graph = self.graph = wired(**options)
        self.events: list[str] = []
        devices = [
            Device(d, graph.row.devices[i], graph.actuators_of(i), self.events.append)
            for i, d in enumerate(graph.devices)
        ]
        self.hand, self.arm, self.panel, *self.others = (d.driver for d in devices)
        for d in devices:
            d.driver.open()
            d.watch()
        self.run_folder = RunFolder(folder)
        RequestWriter.create(self.run_folder.requests)
        ring = RingWriter.create(self.run_folder.rows, graph.layout.width, 4096)
        limits = limits_of(graph)
        meta = graph.layout.meta
        meta["limits"] = {n: _plain(v) for n, v in limits.items()}
        meta["automatic"], meta["latches"] = automatic, names(latched)
        self.cycle = Cycle(graph, limits, automatic, latched, report=self.events.append)
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

        requests = RequestQueue(self.run_folder, graph, ControlEnd(self.run_folder.stop_socket))
        self.loop = Loop(graph, devices, Steps(Fraction(100)), self.cycle, requests, ring)

    def run(self, cycles: int, script: Callable[[int], None]) -> Bench:
        self.cycles, self.script = cycles, script
        self.loop.run()
        for device in self.loop.devices:
            device.close()  # ends its thread, which holds it and so the whole loop
        return self

    def ask(self, what: str, cause: str | None = None) -> None:
        send_request(self.run_folder, what, cause, timeout=0.0)

    def until_back(self, driver: Driver) -> None:
        """Waits until the thread that opens it again is done."""
        (device,) = (each for each in self.loop.devices if each.driver is driver)
        until(device._back.is_set)

    def rows(self) -> Any:
        return RingReader(self.run_folder.rows).take()

    def header(self, name: str) -> Any:
        return self.graph.layout.header(self.rows(), name)
