"""Simulated drives on a CAN bus: the firmware of each, the fake that puts the driver before it, and the twin.

The fake is the driver itself, with the frames of a bus in memory: the wire is the twin's own, frame by frame.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import ClassVar

import can
from pydantic import Field

from srl.drivers.can_axes.driver import CanAxes
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.world import FakeConfig, World
from srl.sim.devices.shared.can import CanTwin
from srl.sim.devices.shared.driver_fake import DriverFake
from srl.sim.devices.shared.memory_can import MemoryCan
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone, require_cell
from srl.sim.parts.actuators.chain import ActuatorChain
from srl.sim.parts.actuators.motors import ActuatorMotors


class FakeDrivesConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that a frame of a drive is lost")
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the bus is gone")
    bus: str | None = Field(
        default=None, description="can://INTERFACE/CHANNEL the twin joins; None: multicast that stays on this host"
    )


class Node(ABC):
    """One drive: its firmware on one motor of a chain.

    Attributes:
        motors, i: the chain's motors, and which of them it drives.
        scale: 1 or -1, the axis' direction in the shaft's angle.
        mute: it obeys and says nothing: its transmitter is broken.
        deaf: it says all and hears nothing.
    """

    def __init__(self, chain: ActuatorChain, i: int) -> None:
        self.chain, self.i = chain, i
        self.mute = self.deaf = False
        chain.measure()

    @property
    def motors(self) -> ActuatorMotors:
        """The chain's motors, with the angles read last."""
        return self.chain.motors

    @abstractmethod
    def power_up(self) -> None:
        """Its supply comes back: it knows what a power-up leaves."""

    def power_down(self) -> None:
        """Its supply is gone: no torque, no word."""
        self.motors.power_off(self.i)

    def brown_out(self) -> None:
        """Its supply dips: it starts anew."""
        self.power_down()
        self.chain.measure()
        self.power_up()

    @abstractmethod
    def take(self, message: can.Message, now: int) -> Sequence[can.Message]:
        """Obeys a frame, if it is for this drive; returns its answers."""

    @abstractmethod
    def due(self, now: int) -> Sequence[can.Message]:
        """Runs until `now` (ns of world time); returns what it sends by itself."""


def numbers(chain: ActuatorChain, names: Sequence[str], device: str) -> list[int]:
    """For each axis of a device, the number of the chain's axis with its name. Raises WiringError."""
    for name in names:
        if name not in chain.names:
            raise WiringError(
                f"sim.devices.{device}", f"the chain '{chain.name}' has no axis '{name}'", nearest(name, chain.names)
            )
    return [chain.names.index(name) for name in names]


class FakeDrives(DriverFake):
    """Drives of one bus: the driver, before simulated firmware.

    When the bus is lost, the drives go on until their own time limit. Drop-outs depend only on the seed, the name and
    the number of the frame.

    Attributes:
        nodes: in the order of the profile's axes.
    """

    Options = FakeDrivesConfig
    real: ClassVar[type[CanAxes]]
    driver: CanAxes

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeDrivesConfig) -> None:
        super().__init__(name, config, world, options)
        self.drive_options = options
        link = partial(MemoryCan, name, self.take, self.due, lambda: self.is_gone)
        self.driver.connect = link  # type: ignore[method-assign]
        self.chain = require_cell(world, name).part(ActuatorChain, name, options.part)
        of = numbers(self.chain, self.driver.labels, name)
        self.nodes = [self.node(k, i) for k, i in enumerate(of)]
        self._noise = SampleNoise(world.seed, name, 1, 1.0)
        self._sent = 0

    @abstractmethod
    def node(self, k: int, i: int) -> Node:
        """The firmware of axis `k` of the profile, which is axis `i` of the chain."""

    @property
    def is_gone(self) -> bool:
        """Whether the bus is gone."""
        return inside(self.drive_options.loss, self.world.time)

    def take(self, message: can.Message) -> list[can.Message]:
        """A frame of the host; returns what the drives answer."""
        self.chain.measure()
        found = list[can.Message]()
        for node in self.nodes:
            if node.motors.powered[node.i] and not node.deaf:
                answers = node.take(message, self.world.time)
                found += [] if node.mute else answers
        return found

    def due(self, at_once: bool = False) -> list[can.Message]:
        """What the drives send by themselves; with `at_once`, as if their time had come."""
        self.chain.measure()
        found = list[can.Message]()
        for node in self.nodes:
            if node.motors.powered[node.i]:
                messages = node.due(self.world.time if not at_once else -1)
                found += [] if node.mute else messages
        if not self.drive_options.dropout or at_once:
            return found
        self._sent += len(found)
        begin = self._sent - len(found)
        return [m for k, m in enumerate(found) if self._noise.uniform(begin + k) >= self.drive_options.dropout]

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self.drive_options.loss, self.world.time)
        super().open()


class DrivesTwin(CanTwin):
    """The drives of a fake on a bus of python-can; see `CanTwin`.

    Attributes:
        nodes: as the fake's.
    """

    def __init__(self, fake: FakeDrives) -> None:
        super().__init__(fake)
        self.drives, self.nodes = fake, fake.nodes
        self._taken: dict[str, int] = {}
        self._first = True

    def power_up(self) -> None:
        """When it is first opened the drives have power already, and know where they are."""
        if self._first:
            self._first = False
            return
        self.drives.chain.measure()
        for node in self.nodes:
            node.power_up()

    def power_down(self) -> None:
        for node in self.nodes:
            node.power_down()

    def take(self, message: can.Message, now: int) -> None:
        key = f"{message.arbitration_id:#x}"
        self._taken[key] = self._taken.get(key, 0) + 1
        self._put(self.drives.take(message))

    def work(self, now: int) -> None:
        self._put(self.drives.due())

    def _put(self, messages: Sequence[can.Message]) -> None:
        for message in messages:
            self.send(message.arbitration_id, bytes(message.data), message.is_extended_id)

    def metrics(self) -> dict[str, object]:
        """Adds frames by identifier, and which drives have torque."""
        motors = self.drives.chain.motors
        return super().metrics() | {
            "taken": dict(self._taken),
            "torque": [bool(motors.torque[n.i]) for n in self.nodes],
        }
