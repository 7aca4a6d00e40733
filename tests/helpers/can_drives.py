"""Simulated drives on a CAN bus: a limb, its fake in a world, its twin on a bus of python-can, all in lockstep."""

from __future__ import annotations

import itertools
import json
import os
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import can
import can.interfaces.virtual
import numpy as np

import srl.drivers.can_axes.driver
import srl.drivers.canbus
import srl.drivers.cubemars_servo.driver
import srl.drivers.odrive.opening
from helpers.twin import Bench, bound
from srl.drivers.can_axes.driver import CanAxes
from srl.drivers.cubemars_servo import CubemarsServo
from srl.drivers.cubemars_servo.config import CubemarsServoConfig
from srl.drivers.odrive import Odrive
from srl.drivers.odrive.config import OdriveConfig
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.signals import Array, Stop
from srl.sim.devices.cubemars_servo.fake import FakeCubemarsServo
from srl.sim.devices.cubemars_servo.twin import CubemarsServoTwin
from srl.sim.devices.odrive.fake import FakeOdrive
from srl.sim.devices.odrive.twin import OdriveTwin
from srl.sim.devices.shared.can_drives import DrivesTwin, FakeDrives, FakeDrivesConfig
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
EPOCH = 1e9  # s, the system's clock when the simulated one begins
MODELS = {"odrive": "ODrive-8", "cubemars-servo": "AK80-9"}
ENDPOINTS = KeptFile(
    Path("flat_endpoints.json"),
    json.dumps(
        {
            "fw_version": "0.6.10",
            "hw_version": "4.4.58",
            "endpoints": {
                "axis0.config.watchdog_timeout": {"id": 323, "type": "float"},
                "axis0.config.enable_watchdog": {"id": 325, "type": "bool"},
                "axis0.config.motor.torque_constant": {"id": 197, "type": "float"},
            },
        }
    ).encode(),
)
_buses = itertools.count()


def cell(kind: str, names: tuple[str, ...], start: float = 0.0, gravity: bool = True, **axis: Any) -> Cell:
    """A chain `arm`: every axis level, links of 0.15 m; the whole stands out and hangs on its motors."""
    axes = {
        name: {"model": MODELS[kind], "axis": [0, 1, 0], "link": [0.15, 0, 0], "lower": -2.6, "upper": 2.6} | axis
        for name in names
    }
    axes[names[0]]["start"] = start
    world = {"parts": {"arm": {"part": "actuator-chain", "axes": axes}}}
    return Cell(CellConfig.model_validate(world if gravity else world | {"gravity": [0, 0, 0]}), 1)


def odrive(
    names: tuple[str, ...] = ("hip", "knee"), axis: dict[str, Any] | None = None, **options: Any
) -> OdriveConfig:
    """Nodes from 1 on, geared 8, by position, firmware 0.6."""
    one = {"gear": 8, "parked": 0.0, "velocity": 6.0, "current": 30.0, "torque_constant": 0.083, "damping": 2.0}
    axes = {name: {"node": k} | one | (axis or {}) for k, name in enumerate(names, 1)}
    new = {"firmware": "0.6", "endpoints": ENDPOINTS}
    given = new if options.get("firmware", "0.6") == "0.6" else {"watchdog_set": True}
    return OdriveConfig.model_validate({"port": "can://virtual/none", "axes": axes} | given | options)


def servo(
    names: tuple[str, ...] = ("hip", "knee"), axis: dict[str, Any] | None = None, **options: Any
) -> CubemarsServoConfig:
    """Ids from 1 on, AK80-9, by position."""
    one = {
        "model": "AK80-9", "parked": 0.0, "lower": -2.0, "upper": 2.0, "velocity": 6.0, "acceleration": 60.0,
        "current": 20.0, "torque_constant": 0.819,
    }  # fmt: skip
    axes = {name: {"id": k} | one | (axis or {}) for k, name in enumerate(names, 1)}
    given = {"port": "can://virtual/none", "timeout": 0.5, "axes": axes} | options
    return CubemarsServoConfig.model_validate(given)


def kind_of(config: Any) -> str:
    return "odrive" if isinstance(config, OdriveConfig) else "cubemars-servo"


def make_fake(config: Any, world: Cell | None = None, **options: Any) -> FakeDrives:
    """The fake of these drives in a limb that hangs on them."""
    kind = kind_of(config)
    cls: Any = FakeOdrive if kind == "odrive" else FakeCubemarsServo
    fake = cls("limb", config, world or cell(kind, tuple(config.axes)), FakeDrivesConfig(**options))
    assert isinstance(fake, FakeDrives)
    return fake


class FakeRig:
    """A fake and its world, cycle by cycle.

    Attributes:
        log: (s, position (n,), torque (n,)) of the axes, true, of every cycle.
    """

    PERIOD = 5 * MS

    def __init__(self, config: Any, world: Cell | None = None, **options: Any) -> None:
        self.fake = bound(make_fake(config, world, **options))
        assert isinstance(self.fake, FakeDrives)
        self.world, self.driver = self.fake.world, self.fake.driver
        self.now = 0
        self.log: list[tuple[float, Array, Array]] = []
        self.fake.open()

    @property
    def nodes(self) -> Any:
        return self.fake.nodes

    @property
    def state(self) -> Any:
        return self.fake.state_arrays

    @property
    def fault(self) -> str:
        return self.fake.health.fault

    @property
    def torque(self) -> list[bool]:
        """Which drives have torque."""
        return [bool(self.fake.chain.motors.torque[node.i]) for node in self.nodes]

    def advance(self) -> None:
        """The world alone: nobody talks to the drives."""
        self.now += self.PERIOD
        self.world.advance(self.now)
        chain = self.fake.chain
        self.log.append((self.now * 1e-9, chain._data.qpos[chain._q].copy(), chain.motors.effort.copy()))

    def cycle(self, command: Any = None, stop: Stop | None = None) -> None:
        """Reads, writes or stops, and lets the period pass. A dead loop: `advance`."""
        self.fake.read(self.now)
        if stop is not None:
            self.fake.stop(stop)
        elif command is not None:
            self.fake.command_arrays[self.fake.commands[0].name][:] = command
            self.fake.write(self.now)
        self.advance()

    def run(self, seconds: float, command: Any = None, stop: Stop | None = None) -> None:
        for _ in range(round(seconds * 1e9 / self.PERIOD)):
            self.cycle(command, stop)

    def hold(self, seconds: float = 0.5) -> Array:
        """Takes up command where the limb is; 0 for a velocity or a torque."""
        self.run(0.02)
        kind = self.fake.commands[0].kind
        where = self.state["position"].copy() if kind == "position" else np.zeros(len(self.nodes))
        self.run(seconds, where)
        return np.asarray(where)

    def truth(self) -> Array:
        """rad, of the axes."""
        return np.array(self.log[-1][1])


class TwinRig:
    """The driver on the twin's bus, in memory of this process; both clocks run together.

    So do the bus' own: a frame is as old as the simulated time since it was sent, however slow the machine is.
    """

    PERIOD = 0.005

    def __init__(self, config: Any, world: Cell | None = None, opened: bool = True, **options: Any) -> None:
        bus = f"can://virtual/drives{os.getpid()}.{next(_buses)}"
        fake = make_fake(config, world, bus=bus)
        cls: Any = OdriveTwin if kind_of(config) == "odrive" else CubemarsServoTwin
        self.twin: DrivesTwin = cls(fake)
        self.bench = Bench(self.twin)
        real: Any = Odrive if kind_of(config) == "odrive" else CubemarsServo
        self.driver: CanAxes = bound(real("limb", config.model_copy(update={"port": bus} | options)))
        self.spy = can.Bus(interface="virtual", channel=bus.removeprefix("can://virtual/"))
        seconds = lambda: self.bench.now * 1e-9  # noqa: E731
        self._clock = SimpleNamespace(monotonic=seconds, time=lambda: EPOCH + seconds(), sleep=self.bench.run)
        self._patches = ExitStack()
        for module in (srl.drivers.canbus, can.interfaces.virtual):
            self._patches.enter_context(patch.object(module, "time", self._clock))
        if opened:
            self.open()

    def __enter__(self) -> TwinRig:
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.close()
        self.twin.close()
        self.spy.shutdown()
        self._patches.close()

    def open(self) -> None:
        """Opens the driver; while it waits, simulated time passes, and no other."""
        with ExitStack() as patches:
            for module in (srl.drivers.can_axes.driver, srl.drivers.odrive.opening, srl.drivers.cubemars_servo.driver):
                patches.enter_context(patch.object(module, "time", self._clock))
            self.driver.open()

    def run(self, seconds: float, command: Any = None, stop: Stop | None = None) -> None:
        for _ in range(round(seconds / self.PERIOD)):
            self.driver.read(self.bench.now)
            if stop is not None:
                self.driver.stop(stop)
            elif command is not None:
                self.driver.command_arrays[self.driver.commands[0].name][:] = command
                self.driver.write(self.bench.now)
            self.bench.now += round(self.PERIOD * 1e9)
            self.bench.world.advance(self.bench.now)
            self.twin.service(self.bench.now)

    def heard(self) -> list[can.Message]:
        """All frames on the bus since the last call."""
        found = []
        while (message := self.spy.recv(timeout=0)) is not None:
            found.append(message)
        return found


def floating(config: Any, **axis: Any) -> Cell:
    """The cell of these axes, without gravity."""
    return cell(kind_of(config), tuple(config.axes), gravity=False, **axis)


def of(rig: TwinRig, k: int = 0) -> Any:
    """The twin's node of an axis, by its number."""
    return rig.twin.nodes[k]


def fault(rig: TwinRig) -> str:
    """What the driver tells of its drives."""
    return rig.driver.health.fault
