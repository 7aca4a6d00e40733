"""A real driver under the real guard: cycle, device, a law that goes on with its wave, and a log of every cycle."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Command, Kind, Signal
from srl.runtime.ipc.header import CYCLE, DEVICE, FLAG_LIMITED, FLAG_RESYNCHRONISED, LINK_ACTIVE, Origin, State
from srl.runtime.ipc.requests import Request, RequestKind
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.device import Device
from srl.runtime.loop.guards import limits_of
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph

FREQUENCY = 0.8  # Hz: after 0.1, 0.5 and 2 s the wave is far from where it was
EPS = 1e-9
LONGEST = 5  # periods of the loop; the guard's own patience, where the command's period is shorter


class WaveConfig(ControllerConfig):
    """The command it is wired to, and the wave's centre and amplitude in the command's unit."""

    unit: str
    labels: tuple[str, ...]
    centre: tuple[float, ...]
    amplitude: float


class Wave(Controller):
    """A sinusoid that goes on whatever becomes of its commands. `phase` counts turns."""

    Config = WaveConfig

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        assert isinstance(config, WaveConfig)
        self.options, self.phase = config, 0.0
        shape = (len(config.centre),)
        self.outputs = (Signal(name="wave", shape=shape, unit=config.unit, labels=config.labels),)

    def reset(self) -> None: ...

    def update(self, dt: float) -> None:
        self.phase += FREQUENCY * dt
        swing = self.options.amplitude * np.sin(2 * np.pi * self.phase)
        self.output["wave"][:] = np.array(self.options.centre) + swing


@dataclass(frozen=True)
class Row:
    """One cycle, after its write. `got` is what reached the device since: (joint, value), oldest first."""

    now: int
    state: State
    flags: int
    active: bool
    commands: int
    asked: Array
    applied: Array
    sent: Array
    measured: Array | None
    got: list[tuple[int, float]]


@dataclass
class Setting:
    """What a wire brings: the driver, its options, the guard's limits and the wave it can follow.

    Attributes:
        rate: how fast the command may change, its unit a second.
        spring: the most that one period adds from rest.
        grain: what the wire rounds to at most, by joint.
        filtered: what a filter in the driver may add to one step.
        late: commands that may leave until one reaches the device: a rest of a frame goes with the next.
        by_joint: each joint has a frame of its own, and a bad link may take some of them.
    """

    driver: str
    options: dict[str, Any]
    command: Command
    guard: dict[str, Any]
    centre: Array
    amplitude: float
    hz: float
    rate: float
    grain: Array
    filtered: float = 0.0
    late: int = 1
    by_joint: bool = False
    spring: float = 0.0

    def __post_init__(self) -> None:
        acceleration = self.guard.get("acceleration")
        per_period = self.rate / self.hz
        self.spring = 0.5 * acceleration / self.hz**2 if self.command.kind is Kind.POSITION else per_period

    @property
    def reach(self) -> Array:
        """The most by which the first command after a stall may differ from the last one before, by joint.

        One period's step from rest. The guard may get as far as the device's resolution without being resynchronised,
        and a position is in motion then.
        """
        resolution = np.broadcast_to(self.command.resolution, self.grain.shape)
        faster = 0.0
        if self.command.kind is Kind.POSITION:
            faster = np.sqrt(2 * self.guard["acceleration"] * resolution) / self.hz
        return self.spring + resolution + faster


def graph(setting: Setting, max_age: float | None) -> Graph:
    """The wired system of one device and the wave."""
    command = setting.command
    name = f"device.{command.name}"
    options = setting.options | {"driver": setting.driver}
    if max_age is not None:
        options["max_age"] = max_age
    wave = {
        "use": "wave", "unit": command.unit, "labels": command.labels, "centre": setting.centre.tolist(),
        "amplitude": setting.amplitude, "out": {"wave": name},
    }  # fmt: skip
    tree = {
        "name": "conformance", "rate": setting.hz, "devices": {"device": options}, "controllers": [wave],
        "guard": {name: setting.guard}, "bus": None,
    }  # fmt: skip
    if max_age is not None:
        tree["meant"] = ["devices.device.max_age"]  # a bad link shall not end the test
    load = registry.load

    def registered(group: str, kind: str, place: str) -> Any:
        return Wave if group == "controllers" else load(group, kind, place)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "load", registered)
        return wiring.build(*profile.parse("conformance.yaml", json.dumps(tree)))


@dataclass
class Wire(ABC):
    """What a link and its far end must offer; see `helpers.wires`. `valve` makes the link a bad one."""

    setting: Setting
    valve: Any = field(init=False)
    now: int = 0  # ns, of both ends
    got: list[tuple[int, float]] = field(default_factory=list)

    @abstractmethod
    def open(self, device: Device) -> None:
        """Opens the driver while the far end answers."""

    @abstractmethod
    def advance(self, lost: bool) -> None:
        """Lets a period pass, until the driver could read what the far end has sent."""

    @abstractmethod
    def settle(self) -> None:
        """Waits until the far end has all that the link has taken."""

    def serving(self) -> AbstractContextManager[object]:
        """The far end answers by itself meanwhile, for what blocks."""
        return nullcontext()

    @abstractmethod
    def leave(self) -> None:
        """The device is gone."""

    @abstractmethod
    def come_back(self) -> None:
        """Another device is in its place, or the same one elsewhere, just switched on."""

    @abstractmethod
    def close(self) -> None:
        """Ends the far end."""


class UnderGuard:
    """Runs the cycle of one device; see the module's text.

    Attributes:
        rows: a row a cycle, since the device was opened.
        wave: the law.
    """

    def __init__(self, wire: Wire, max_age: float | None = 60.0) -> None:
        """`max_age`: s, the profile's; None: the driver's own."""
        self.wire, self.setting = wire, wire.setting
        self.graph = graph(wire.setting, max_age)
        self.events: list[str] = []
        (driver,) = self.graph.devices
        self.device = Device(driver, self.graph.row.devices[0], self.graph.actuators_of(0), self.events.append)
        wire.open(self.device)
        self.device.watch()
        self.cycle = Cycle(self.graph, limits_of(self.graph), automatic=True, report=self.events.append)
        (self.wave,) = self.graph.controllers
        assert isinstance(self.wave, Wave)
        self.rows: list[Row] = []
        self._before = wire.now

    def __enter__(self) -> UnderGuard:
        return self

    def __exit__(self, *_: object) -> None:
        with self.wire.serving():
            self.device.close()
        self.wire.close()

    @property
    def state(self) -> State:
        return self.cycle.machine.state

    def step(self, request: RequestKind = RequestKind.NONE) -> Row:
        """One cycle, as the loop runs it."""
        wire, device, ints = self.wire, self.device, self.graph.row.ints
        wire.advance(device.lost)
        if device.lost:
            time.sleep(0.001)  # for the thread that opens it again, in real time
        ints[CYCLE.now], ints[CYCLE.dt] = wire.now, wire.now - self._before
        self._before = wire.now
        device.read(wire.now)
        self.cycle.check(0, Request(0, request, 0, 0, np.empty(0), Origin.LOCAL) if request else None)
        if self.cycle.machine.recover:
            device.recover(wire.now)
        self.cycle.control()
        self.cycle.guard()
        if device.active:
            device.write(wire.now)
        device.publish(wire.now)
        if not device.lost:
            wire.settle()
        (actuator,) = self.graph.actuators
        got, wire.got = wire.got, []
        row = Row(
            wire.now, self.state, int(ints[CYCLE.flags]), bool(device.header[DEVICE.link] & LINK_ACTIVE),
            int(device.header[DEVICE.commands]), actuator.asked.copy(), actuator.applied.copy(), actuator.sent.copy(),
            None if actuator.measured is None else actuator.measured.copy(), got,
        )  # fmt: skip
        self.rows.append(row)
        return row

    def run(self, seconds: float) -> None:
        """So much time."""
        end = self.wire.now + round(seconds * 1e9)
        while self.wire.now < end:
            self.step()

    def until(self, condition: Callable[[], object], most: float = 20.0) -> None:
        """Steps until it holds; `most` s of the device's time."""
        end = self.wire.now + round(most * 1e9)
        while not condition():
            assert self.wire.now < end, f"never: {self.state.name}, {self.device.driver.health}, {self.events[-3:]}"
            self.step()

    def follows(self) -> bool:
        """The limb has met the wave: for ten cycles the guard has changed nothing and all was sent."""
        limits, last = self.setting, self.rows[-10:]
        near = limits.rate * self._patience * 1e-9 + np.max(limits.command.resolution)
        return len(last) == 10 and all(
            row.state is State.ACTIVE
            and not row.flags & (FLAG_LIMITED | FLAG_RESYNCHRONISED)
            and np.abs(row.sent - row.asked).max() <= near
            for row in last
        )

    def await_middle(self, seconds: float) -> None:
        """Steps until a pause of so many seconds, begun now, has the wave's fastest instant in its middle."""
        wave = self.wave
        assert isinstance(wave, Wave)
        step = FREQUENCY / self.setting.hz
        self.until(lambda: (wave.phase + FREQUENCY * seconds / 2) % 0.5 < 1.01 * step)

    def meet(self, most: float = 20.0) -> int:
        """Until the limb follows the wave again; a stop ends with a reset, as by a person. Returns the resets."""
        end, resets = self.wire.now + round(most * 1e9), 0
        while not self.follows():
            assert self.wire.now < end, f"never: {self.state.name}, {self.device.driver.health}, {self.events[-3:]}"
            if self.state is State.STOPPED and not self.device.lost:
                resets += 1
                self.step(RequestKind.RESET)
            else:
                self.step()
        return resets

    @property
    def _patience(self) -> int:
        """ns that the guard waits for a command to leave."""
        return round(max(self.setting.command.period or 0.0, LONGEST / self.setting.hz) * 1e9)

    # -- what must hold of every log

    def judge(self) -> None:
        """Checks the whole log: what reached the device is `.sent`, and makes no step beyond the limits."""
        self._match()
        self._seats()

    def _match(self) -> None:
        """What reached the device left just before, in the same order, and is near to what left before it."""
        setting, rows = self.setting, self.rows
        lefts: list[Array] = []  # what has left
        times: list[tuple[int, int]] = []  # when, ns, and until when the device was held to what was applied
        holds = False  # since it left, what was applied has stayed within the resolution: nothing else had to leave
        newest: dict[int, int] = {}  # by joint: number of what it got last
        begin, fresh = rows[0], dict.fromkeys(range(len(rows[0].sent)), True)  # not moved since the start or reset
        for before, row in zip([rows[0], *rows], rows, strict=False):
            left = row.commands > before.commands or (row is rows[0] and row.commands > 0)
            if left:
                lefts.append(row.sent)
                times.append((row.now, row.now))
            holds = (holds or left) and bool((np.abs(row.sent - row.applied) <= setting.command.resolution).all())
            if holds:
                times[-1] = times[-1][0], row.now
            if row.active and not before.active:
                begin, fresh = row, dict.fromkeys(fresh, True)
            for joint, value in row.got:
                grain = setting.grain[joint]
                if not row.active and value == 0 and setting.command.kind is not Kind.POSITION:
                    continue  # rest: before the first command, in a stop, or when it is opened again
                first = max(newest.get(joint, 0), len(lefts) - 1 - setting.late)
                near = [k for k in range(first, len(lefts)) if abs(lefts[k][joint] - value) <= grain]
                assert near, f"at {row.now} joint {joint} got {value}; left had {lefts[-3:]}"
                at, was = times[near[-1]][0], self._start(begin, joint)
                far, most = abs(value - was), setting.rate * self._patience * 1e-9
                if setting.command.kind is Kind.VELOCITY and not lefts[near[-1]].any():
                    far = 0.0  # rest: the device's own time-out
                elif not fresh[joint]:
                    last = newest[joint]
                    far, gap = abs(lefts[near[-1]][joint] - lefts[last][joint]), at - times[last][1]
                    most = setting.rate * gap * 1e-9 if gap <= self._patience + 1 else setting.reach[joint]
                most = most * (1 + 1e-6) + setting.filtered + 2 * grain
                assert far <= most, (
                    f"at {row.now} joint {joint} got {value}, {far} from before, at most {most}; {fresh}"
                )
                newest[joint], fresh[joint] = near[-1], False

    def _start(self, begin: Row, joint: int) -> float:
        """Where motion begins after a start or reset in this cycle."""
        if self.setting.command.kind is not Kind.POSITION:
            return 0.0
        return float(begin.applied[joint])

    def _seats(self) -> None:
        """Where the guard was resynchronised, its command is at most one period away from what was sent.

        Of a bus on which each joint has a frame of its own, one that was sent as applied within the guard's patience
        goes on, and one of which nothing was sent since the start or reset begins anew at the first command.
        """
        started = first = self.rows[0]  # the row before the start or reset, and its first one
        resolution = np.broadcast_to(self.setting.command.resolution, self.setting.grain.shape)
        taken = np.full(len(resolution), self.rows[0].now)  # ns, by joint, when it was last sent as applied
        for earlier, before, row in zip(self.rows[:1] + self.rows, self.rows, self.rows[1:], strict=False):
            for applied in (before.applied, earlier.applied):
                taken[np.abs(before.sent - applied) <= resolution] = before.now
            if row.active and not before.active:
                started, first = before, row
            if row.flags & FLAG_RESYNCHRONISED and before.commands > started.commands:
                most = self.setting.spring * (1 + 1e-6) + EPS
                near = np.abs(row.applied - before.sent) <= most
                if self.setting.by_joint:
                    near |= row.now - taken <= self._patience + round(1e9 / self.setting.hz)
                    near |= (before.sent == started.sent) & (np.abs(row.applied - first.applied) <= most + resolution)
                assert near.all(), (row.now, row.applied, before.sent)

    def resynchronised(self, begin: int, end: int | None = None) -> int:
        """Cycles in which the guard was resynchronised, without those that follow a hold-up of this very loop."""
        period, found, held_up = 1e9 / self.setting.hz, 0, -LONGEST
        for k in range(max(begin - LONGEST, 1), len(self.rows) if end is None else end):
            if self.rows[k].now - self.rows[k - 1].now > 2.5 * period:
                held_up = k
            found += k >= begin and bool(self.rows[k].flags & FLAG_RESYNCHRONISED) and k - held_up > LONGEST
        return found
