"""Surface EMG of a simulated person's muscles."""

from __future__ import annotations

import zlib
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from srl.drivers.trigno import Trigno, TrignoConfig
from srl.drivers.trigno.envelope import Envelope
from srl.drivers.trigno.protocol import FRAME, RANGE, RATE, SLOTS
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceLostError, WiringError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.surface_emg import Muscles, SurfaceEmg, muscles
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone

IN_FRAME: Final = 27  # samples in a frame
_CATCH_UP: Final = 80  # most frames in one read


class FakeTrignoConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's part whose muscles are measured; None: the script")
    activation: dict[str, tuple[tuple[float, float], ...]] = Field(
        default_factory=dict,
        description="by muscle, [s, 0..1] points of world time, straight lines between",
    )
    mvc: float = Field(default=5e-4, gt=0, le=RANGE, description="V, RMS at the greatest voluntary contraction")
    gains: dict[str, Annotated[float, Field(gt=0, le=RANGE)]] = Field(
        default_factory=dict, description="V, the same of muscles whose own differs: skin and electrode decide it"
    )
    noise: float = Field(default=2e-6, ge=0, description="V, RMS of the electronics")
    mains: float = Field(default=0.0, ge=0, description="V, amplitude of a 50 Hz hum")
    delay: float = Field(default=0.02, ge=0, le=0.5, description="s, from the end of a radio frame to its arrival")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that a radio frame never comes")
    out_of_reach: dict[str, Windows] = Field(
        default_factory=dict, description="by muscle, [from, to] pairs, s, during which its sensor isn't received"
    )
    loss: Windows = Field(default=(), description="s, pairs during which the server is gone")


class FakeTrigno(Sensor, Fake):
    """Gives EMG: noise in the muscle's band, scaled with the muscle's activation; 16 bits over +-11 mV.

    Radio frame j has 27 samples and begins at 13.5 j ms of world time. It depends only on seed, name, j and the
    activation.
    """

    Options = FakeTrignoConfig
    real = Trigno

    def __init__(self, name: str, config: TrignoConfig, world: World, options: FakeTrignoConfig) -> None:
        super().__init__(name, config, world, options)
        self.channels, self.script = config.channels, options
        self._block_size, self._latency = config.block, round(config.latency * 1e9)
        self._muscles = self._find()
        self._key = [world.seed, zlib.crc32(name.encode())]
        self._electrodes = SurfaceEmg(self._key, SLOTS, RATE)
        self._envelope = Envelope(len(config.channels), max(round(config.window * RATE), 1))
        self._zeros = np.zeros(len(config.channels), int)
        self._next = 0  # number of the next frame
        self._count = 0

    def open(self) -> None:
        refuse_while_gone(self.name, self.script.loss, self.world.time)
        self._next = max(self.newest() + 1, 0)
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected or inside(self.script.loss, self.world.time):
            self.health.connected = False
            raise DeviceLostError(self.name, "the simulated server is gone", "It comes back after its 'loss' window")
        newest = self.newest()
        if newest < self._next - 1:  # the world was restored to an earlier state
            self._next = newest + 1
        for number in range(max(self._next, newest + 1 - _CATCH_UP, 0), newest + 1):
            frame = self.frame(number)
            if frame is None:
                self.health.errors += IN_FRAME
                continue
            self._take(frame[:, [slot - 1 for slot in self.channels.values()]])
            if self.state_arrays["present"].all():
                taken = round((number + 1) * FRAME * 1e9)
                self.health.stamp = now - (self.world.time - taken) - self._latency
        self._next = newest + 1

    def close(self) -> None:
        self.health.connected = False

    def _take(self, samples: Array) -> None:
        state, block = self.state_arrays, self._block_size
        self.health.frames += len(samples)
        self._count += len(samples)
        self._envelope.take(samples)
        state["emg"][:], state["envelope"][:] = samples[-1], self._envelope.value
        gone = (samples == 0).all(axis=0)
        self._zeros = np.where(gone, self._zeros + len(samples), 0)
        state["present"][:] = self._zeros < 0.1 * RATE
        if block:
            new = samples[-block:]
            state["samples"][:] = np.concatenate([state["samples"][len(new) :], new])
            state["count"][0] = self._count

    # -- the base station itself, used by the fake and the twin

    def newest(self) -> int:
        """Number of the newest frame that has arrived; -1 before the first."""
        return int((self.world.time * 1e-9 - self.script.delay) / FRAME + 1e-9) - 1

    def frame(self, number: int) -> Array | None:
        """Samples (27, 16), V, of a frame; None if the frame is lost. Slots without a muscle are 0."""
        if self.script.dropout and np.random.default_rng([*self._key, 1, number]).random() < self.script.dropout:
            return None
        first = number * IN_FRAME
        time = first / RATE
        out = np.zeros((IN_FRAME, SLOTS))
        hum = self.script.mains * np.sin(2 * np.pi * 50 * (time + np.arange(IN_FRAME) / RATE))
        for muscle, slot in self.channels.items():
            if inside(self.script.out_of_reach.get(muscle, ()), round(time * 1e9)):
                continue
            strength = self.script.gains.get(muscle, self.script.mvc) * self._activation(muscle, time)
            unit = self._electrodes.unit(first, IN_FRAME, slot - 1)
            values = strength * unit[0] + self.script.noise * unit[1] + hum
            out[:, slot - 1] = np.clip(np.round(values / RANGE * 32767), -32768, 32767) * RANGE / 32767
        return out

    def _activation(self, muscle: str, time: float) -> float:
        if self._muscles is not None:
            return float(np.clip(self._muscles.activation(muscle), 0.0, 1.0))
        points = self.script.activation.get(muscle, ((0.0, 0.1),))
        times, values = zip(*points, strict=True)
        return float(np.interp(time, times, values))

    def _find(self) -> Muscles | None:
        if unknown := [muscle for muscle in self.script.gains if muscle not in self.channels]:
            place = f"sim.devices.{self.name}.gains"
            raise WiringError(place, f"the device has no channel '{unknown[0]}'", nearest(unknown[0], self.channels))
        named = self.script.part
        return None if named is None else muscles(self.world, f"sim.devices.{self.name}.part", named)
