"""MIT-mode actuators in the simulated world: the driver itself, on a bus in memory, with simulated drives."""

from __future__ import annotations

import can
from pydantic import Field

from srl.drivers.mit_can import MitCan
from srl.drivers.mit_can.config import MitCanConfig
from srl.runtime.contracts.errors import DeviceLostError, WiringError, nearest
from srl.runtime.contracts.world import FakeConfig, World
from srl.sim.devices.mit_can.drives import Drives
from srl.sim.devices.shared.driver_fake import DriverFake
from srl.sim.devices.shared.memory_can import MemoryCan
from srl.sim.devices.shared.servo_chain import numbers
from srl.sim.devices.shared.windows import Windows, inside, require_cell
from srl.sim.parts.actuators.chain import ActuatorChain


class FakeMitCanConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    bus: str | None = Field(
        default=None, description="can://INTERFACE/CHANNEL the twin joins; None: multicast that stays on this host"
    )
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time without power on all drives")
    silent: dict[str, Windows] = Field(default={}, description="the same by motor: its CAN cable is out")
    brown_out: dict[str, Windows] = Field(default={}, description="the same by motor: it has no power")
    silence: float = Field(
        default=0.0, ge=0, description="s without a frame after which a CubeMars slackens; 0: it goes on for ever"
    )


class FakeMitCan(DriverFake):
    """The driver and its simulated drives; nothing lies between them but the bus.

    Attributes:
        drives: the simulated drives, which a test may break.
    """

    Options = FakeMitCanConfig
    real = MitCan
    config: MitCanConfig
    driver: MitCan

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
        self.driver.timeout = 0.0
        self.driver.connect = lambda: MemoryCan(f"{name} ({config.port})", self._obey)  # type: ignore[method-assign]

    @property
    def drives(self) -> Drives:
        """The simulated drives, with encoders read now."""
        motors = self.chain.measure()
        if self._drives is None or self._drives.motors is not motors:
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

    def open(self) -> None:
        self.follow()
        super().open()

    def read(self, now: int) -> None:
        self._check()
        self.follow()
        super().read(now)

    def write(self, now: int) -> None:
        self._check()
        super().write(now)

    def _check(self) -> None:
        if not self.health.connected:
            raise DeviceLostError(self.name, "it isn't open", "Open it first")

    def _obey(self, message: can.Message) -> list[can.Message]:
        answers = self.drives.take(message.arbitration_id, bytes(message.data), bool(message.is_extended_id))
        return [can.Message(arbitration_id=i, data=d, is_extended_id=e) for i, d, e in answers]
