"""A recorded device in a simulated world, with the real driver's player: the loop's clock is the world's there."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from srl.drivers.replay import Replay, ReplayConfig
from srl.drivers.replay.driver import Player
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone, rising


class FakeReplayOptions(FakeConfig):
    """Options of the fake."""

    loss: Annotated[Windows, AfterValidator(rising)] = Field(
        default=(), description="s, [from, to] pairs in world time during which the device is gone"
    )


class FakeReplay(Sensor, Fake):
    """Plays the recording on world time: it starts with the world, also after a loss."""

    Options = FakeReplayOptions
    real = Replay

    def __init__(self, name: str, config: ReplayConfig, world: World, options: FakeReplayOptions) -> None:
        super().__init__(name, config, world, options)
        self._options = options
        self._player = Player(config, name)

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._options.loss, self.world.time)
        if self._player.over:
            self._player.rewind()  # raises the error that the recording is over
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected or inside(self._options.loss, self.world.time):
            self.health.connected = False
            raise DeviceLostError(self.name, "the recorded device is gone", "It comes back at its 'loss' window's end")
        player, time = self._player, self.world.time
        before = player.stamp
        try:
            values = player.play(time)
        except DeviceLostError:
            self.health.connected = False
            raise
        self.health.frames = player.frames
        if player.stamp != before:
            self.health.stamp = now - (time - player.stamp)
        if values is not None:
            for signal, array in zip(self.states, values, strict=True):
                self.state_arrays[signal.name][...] = array

    def close(self) -> None:
        self.health.connected = False
