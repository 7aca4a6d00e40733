"""A chain of simulated MX servos, its twin, and the driver on it, in lockstep."""

from __future__ import annotations

import fcntl
import struct
import termios
from typing import Any, Self

import numpy as np
import pytest

from helpers.twin import Bench, bound
from helpers.wait import until
from srl.drivers.dynamixel import Dynamixel
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.runtime.contracts.signals import Array
from srl.sim.devices.dynamixel.fake import FakeDynamixel, FakeDynamixelConfig
from srl.sim.devices.dynamixel.twin import DynamixelTwin
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
THREE = {"shoulder": {"model": "MX-106"}, "elbow": {"model": "MX-64"}, "slide": {"model": "MX-28", "m_per_rad": 0.01}}
_AXES = {
    "shoulder": {"axis": [0, 0, 1]},
    "elbow": {"axis": [0, 1, 0]},
    "slide": {"axis": [1, 0, 0], "link": [0.05, 0, 0]},
}


def cell(motors: dict[str, dict[str, Any]] = THREE, seed: int = 1, upper: float = 2.6, **options: Any) -> Cell:
    """A chain `arm` with these motors; slides may move by 50 mm, others up to `upper`, rad."""
    axes = {}
    for name, motor in motors.items():
        built = {key: value for key, value in motor.items() if key in ("model", "m_per_rad", "reversed", "zero")}
        ends = {"lower": -0.05, "upper": 0.05} if "m_per_rad" in motor else {"upper": upper}
        axes[name] = _AXES.get(name, {"axis": [0, 1, 0]}) | built | ends
    part = {"part": "dynamixel-chain", "axes": axes} | options
    return Cell(CellConfig.model_validate({"parts": {"arm": part}, "gravity": [0, 0, 0]}), seed)


def config(motors: dict[str, dict[str, Any]] = THREE, port: str = "/dev/null", **options: Any) -> DynamixelConfig:
    """Ids from 1 on in the motors' order, unless given; 1 Mbit/s."""
    numbered = {name: {"id": k} | motor for k, (name, motor) in enumerate(motors.items(), 1)}
    return DynamixelConfig.model_validate({"port": port, "baudrate": 1_000_000, "motors": numbered} | options)


def make_twin(
    motors: dict[str, dict[str, Any]] = THREE, world: Cell | None = None, **options: Any
) -> DynamixelTwin:  # fmt: skip
    """The twin of such a bus; the world is one without a wall."""
    fake = FakeDynamixel("bus", config(motors, **options), world or cell(motors), FakeDynamixelConfig())
    return DynamixelTwin(fake)


class Rig:
    """A twin with a driver on its port; both clocks run together, `PERIOD` a cycle.

    Attributes:
        twin, driver, bench: what it is made of.
        log: stamps and positions of every cycle.
    """

    PERIOD = 10 * MS

    def __init__(self, twin: DynamixelTwin, **options: Any) -> None:
        self.twin = twin
        self.bench = Bench(twin)
        base = twin.bus.config.model_dump() | {"port": twin.address} | options
        self.driver = bound(Dynamixel("bus", DynamixelConfig.model_validate(base)))
        self.log: list[tuple[int, Array]] = []
        self.open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.driver.close()
        self.twin.close()

    def open(self) -> None:
        """Opens the driver, the twin answering meanwhile."""
        with self.bench.running(frozen=True):
            self.driver.open()

    @property
    def state(self) -> dict[str, Array]:
        """The driver's states."""
        return dict(self.driver.state_arrays)

    @property
    def now(self) -> int:
        """ns of both clocks."""
        return self.bench.now

    def cycle(self, command: Any = None) -> None:
        """Reads, writes a command if there is one, and lets the period pass."""
        self.driver.read(self.now)
        self.log.append((self.driver.health.stamp, self.driver.state_arrays["position"].copy()))
        if command is not None:
            array = self.driver.command_arrays[self.driver.commands[0].name]
            array[:] = self.state["position"] if isinstance(command, str) else command
            self.driver.write(self.now)
        sent = self._written()
        # A pty delivers in its own time.
        until(lambda: self._taken() >= sent, lambda: self.twin.service(self.now), pause=0.0)
        self.bench.run(self.PERIOD / 1e9)
        self._await_answers()

    def run(self, cycles: int, command: Any = None) -> None:
        """So many cycles."""
        for _ in range(cycles):
            self.cycle(command)

    def start(self) -> None:
        """Until the first sample."""
        for _ in range(20):
            if self.driver.health.stamp >= 0:
                return
            self.cycle()
        raise AssertionError("no sample")

    def hold(self, cycles: int = 5) -> Array:
        """Takes up command where the axes are; gives that command."""
        self.start()
        where = self.state["position"].copy()
        if self.driver.config.command != "position_command":
            where = np.zeros_like(where)
        self.run(cycles, where)
        return where

    def _written(self) -> int:
        return self._link.sent if self._link is not None else self._taken()

    @property
    def _link(self) -> Any:
        link = self.driver._link
        if link is not None and not isinstance(link, Counting):
            link = Counting(link, self._taken(), self.twin.door.bytes_out)
            self.driver._link = link
            if self.driver._line is not None:
                self.driver._line.link = link
        return link

    def _taken(self) -> int:
        count = self.twin.metrics()["bytes_in"]
        assert isinstance(count, int)
        return count

    def _await_answers(self) -> None:
        """A pty hands bytes over in its own time: waits until the driver could read all that the twin has sent."""
        link = self._link
        if link is not None:
            until(lambda: link.received + waiting(link.fileno()) >= self.twin.door.bytes_out, pause=0.0)


def waiting(fd: int) -> int:
    """Bytes that can be read."""
    return int(struct.unpack("i", fcntl.ioctl(fd, termios.FIONREAD, bytes(4)))[0])


class Counting:
    """A transport that counts the bytes it has written and read."""

    def __init__(self, link: Any, before: int, received: int) -> None:
        self._link = link
        self.sent = before
        self.received = received - waiting(link.fileno())

    def write(self, data: bytes) -> bool:
        taken: bool = self._link.write(data)
        self.sent += len(data) * taken
        return taken

    def read(self) -> bytes:
        data: bytes = self._link.read()
        self.received += len(data)
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)


BOTH = pytest.mark.parametrize("protocol", [2, 1])


TWO = {"shoulder": {"model": "MX-106"}, "elbow": {"model": "MX-64"}}
X = {"shoulder": {"model": "XM430-W350"}, "elbow": {"model": "XL330-M288"}}
PRESSING = {"shoulder": X["shoulder"] | {"effort": 2.0}, "elbow": X["elbow"] | {"effort": 0.2}}


def truth(rig: Rig) -> Any:
    return rig.twin.bus.world.truth_arrays["arm_position"].copy()


def near(found: Any, wanted: Any, atol: Any) -> None:
    """Each within its own tolerance."""
    assert (np.abs(np.asarray(found) - wanted) <= atol).all(), (found, wanted)


def torque(rig: Rig) -> Any:
    return rig.twin.metrics()["torque"]
