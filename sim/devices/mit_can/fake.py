"""MIT-mode actuators in the simulated world: the driver itself, on a bus in memory, with simulated drives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import can
from pydantic import AfterValidator, Field

from srl.drivers.canbus import CanLink
from srl.drivers.mit_can import MitCan
from srl.drivers.mit_can.config import MitCanConfig
from srl.runtime.contracts.errors import DeviceLostError, WiringError, nearest
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.mit_can.drives import Drives
from srl.sim.devices.shared.memory_can import MemoryCan
from srl.sim.devices.shared.servo_chain import numbers
from srl.sim.devices.shared.windows import Windows, inside, require_cell, rising
from srl.sim.parts.actuators.chain import ActuatorChain

Gone = Annotated[Windows, AfterValidator(rising)]


class FakeMitCanConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    bus: str | None = Field(
        default=None, description="can://INTERFACE/CHANNEL the twin joins; None: multicast that stays on this host"
    )
    loss: Gone = Field(default=(), description="s, [from, to] pairs in world time without power on all drives")
    silent: dict[str, Gone] = Field(default={}, description="the same by motor: its CAN cable is out")
    brown_out: dict[str, Gone] = Field(default={}, description="the same by motor: it has no power")
    silence: float = Field(
        default=0.0, ge=0, description="s without a frame after which a CubeMars slackens; 0: it goes on for ever"
    )


class FakeMitCan(Fake):
    """The driver and its simulated drives; nothing lies between them but the bus.

    Attributes:
        drives: the simulated drives, which a test may break.
    """

    Options = FakeMitCanConfig
    real = MitCan

    def __init__(self, name: str, config: MitCanConfig, world: World, options: FakeMitCanConfig) -> None:
        super().__init__(name, config, world, options)
        self._options = options
        self.chain = require_cell(world, name).part(ActuatorChain, name, options.part)
        self.numbers = numbers(self.chain, config.motors, name)
        for key in ("silent", "brown_out"):
            for motor in getattr(options, key):
                if motor not in config.motors:
                    raise WiringError(
                        f"sim.devices.{name}.{key}", f"there is no motor '{motor}'", nearest(motor, config.motors)
                    )
        self._names = list(config.motors)
        self._drives: Drives | None = None
        self._out = [False] * len(self._names)
        self._driver = _OnDrives(name, config, self)
        self.health = self._driver.health

    @property
    def drives(self) -> Drives:
        """The simulated drives, with encoders read now."""
        motors = self.chain.measure()
        if self._drives is None or self._drives.motors is not motors:
            assert isinstance(self.config, MitCanConfig)
            self._drives = Drives(self.config, motors, self.numbers, self._options.silence)
        return self._drives

    def follow(self) -> Drives:
        """The drives, after the faults of the options have come and gone."""
        drives, options, now = self.drives, self._options, self.world.time
        for k, name in enumerate(self._names):
            out = inside(options.loss, now) or inside(options.brown_out.get(name, ()), now)
            if out != self._out[k]:
                self._out[k] = out
                if out:
                    drives.power_down(k)
                else:
                    drives.power_up(k)
            if name in options.silent:
                cut = inside(options.silent[name], now)
                (drives.unplugged.add if cut else drives.unplugged.discard)(k)
        return drives

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        self._driver.bind(states, commands)
        self.state_arrays, self.command_arrays = states, commands
        self.sent_arrays = self._driver.sent_arrays

    def open(self) -> None:
        self.follow()
        self._driver.open()
        self.limits = self._driver.limits

    def read(self, now: int) -> None:
        self._check()
        self.follow()
        self._driver.read(now)

    def write(self, now: int) -> None:
        self._check()
        self._driver.write(now)

    def stop(self, category: Stop) -> None:
        self._driver.stop(category)

    def close(self) -> None:
        self._driver.close()

    def recover(self, now: int) -> None:
        self._driver.recover(now)

    def metrics(self) -> dict[str, object]:
        return self._driver.metrics()

    def _check(self) -> None:
        if not self.health.connected:
            raise DeviceLostError(self.name, "it isn't open", "Open it first")


class _OnDrives(MitCan):
    """The driver, on a bus in memory."""

    timeout = 0.0

    def __init__(self, name: str, config: MitCanConfig, fake: FakeMitCan) -> None:
        super().__init__(name, config)
        self._fake = fake

    def connect(self) -> CanLink:
        def obey(message: can.Message) -> list[can.Message]:
            answers = self._fake.drives.take(message.arbitration_id, bytes(message.data), bool(message.is_extended_id))
            return [can.Message(arbitration_id=i, data=d, is_extended_id=e) for i, d, e in answers]

        return MemoryCan(self._place, obey)
