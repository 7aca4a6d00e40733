"""A ring that a scripted person presses."""

from __future__ import annotations

from pydantic import Field

from srl.drivers.debounce import Debounced
from srl.drivers.ring import Ring, RingConfig
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone


class FakeRingConfig(FakeConfig):
    """Options of the fake."""

    presses: Windows = Field(default=(), description="s, [from, to] pairs in world time during which it is pressed")
    bounce: float = Field(
        default=0.002,
        ge=0,
        le=0.1,
        description="s after each edge during which its contact chatters, 1000 times a second",
    )
    asleep: Windows = Field(default=(), description="s, pairs during which a Bluetooth ring sleeps")
    loss: Windows = Field(default=(), description="s, pairs during which a serial ring is unplugged")


class FakeRing(Sensor, Fake):
    """The script's switch, with contact bounce, read through the driver's own debouncing."""

    Options = FakeRingConfig
    real = Ring
    config: RingConfig

    def __init__(self, name: str, config: RingConfig, world: World, options: FakeRingConfig) -> None:
        super().__init__(name, config, world, options)
        self.script, self.hold = options, config.hold
        self._switch = Debounced(config.debounce)
        self._held = False

    def press(self, down: bool) -> None:
        """Somebody in this process holds the button down, besides its script. No part of the world's state."""
        self._held = down

    def open(self) -> None:
        refuse_while_gone(self.name, self.script.loss, self.world.time)
        self._switch.start(0.0)
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected or inside(self.script.loss, self.world.time):
            self.health.connected = False
            raise DeviceLostError(self.name, "the simulated ring is unplugged", "It comes back after its 'loss' window")
        if self.asleep():
            self._switch.start(0.0)
            self.health.message = "asleep: its first press wakes it"
        else:
            self._switch.take(self.contact(), self.world.time)
            self._switch.settle(self.world.time)
            self.health.message = "awake"
        self.state_arrays["buttons"][0] = self._switch.pressed if self.hold else 0.0
        self.state_arrays["presses"][0] = self._switch.presses
        self.health.frames += 1
        self.health.stamp = now

    def close(self) -> None:
        self.health.connected = False

    # -- the ring itself, used by the fake and the twin

    def asleep(self) -> bool:
        """Whether a Bluetooth ring is asleep now."""
        return inside(self.script.asleep, self.world.time)

    def contact(self) -> float:
        """Whether the contact is closed now, 0 or 1; it bounces after each edge."""
        now, bounce = self.world.time, round(self.script.bounce * 1e9)
        pressed = self._held or inside(self.script.presses, now)
        for edge in (round(t * 1e9) for window in self.script.presses for t in window):
            if 0 <= now - edge < bounce:
                return float(pressed != bool((now - edge) // 1_000_000 % 2))
        return float(pressed)
