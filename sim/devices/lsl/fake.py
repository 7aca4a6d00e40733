"""A stream of the Lab Streaming Layer in a simulated world: the world's truth, a person's muscles, or sine waves."""

from __future__ import annotations

import math
import zlib
from typing import Final

import numpy as np
from pydantic import Field

from srl.drivers.lsl import Lsl, LslConfig
from srl.drivers.lsl.match import Picked
from srl.drivers.lsl.rows import Rows
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import AnyWorldFake, SensorOptions
from srl.sim.devices.shared.surface_emg import SurfaceEmg, muscles
from srl.sim.devices.shared.windows import Windows, inside

_AT_ONCE: Final = 32  # samples of EMG that are made together


class FakeLslOptions(SensorOptions):
    """Options of the fake. `rate` counts for an irregular stream; a regular one has its own."""

    delay: float = Field(default=0.01, ge=0, le=0.5, description="s, from sampling to arrival")
    signals: dict[str, str] = Field(
        default_factory=dict, description="signal -> a signal of the world's truth; without one it is a sine"
    )
    part: str | None = Field(
        default=None, description="the cell's part whose muscles the channels of signals in V are named after"
    )
    mvc: float = Field(default=5e-4, gt=0, description="V, RMS at the greatest voluntary contraction")
    floor: float = Field(default=2e-6, ge=0, description="V, RMS of the electronics")
    amplitude: float = Field(default=0.1, ge=0, description="of the sines, in the signal's unit")
    period: float = Field(default=4.0, gt=0, description="s, of the sines")
    nan: Windows = Field(default=(), description="s, [from, to] pairs in which the stream's first channel here is NaN")


class FakeLsl(Sensor, AnyWorldFake):
    """Takes all channels together at the stream's rate; each sample depends on seed, name, number and the world.

    Attributes:
        rate: Hz.
        columns: the stream's channel, from 0, of each channel here; one may be in several signals.
    """

    Options = FakeLslOptions
    real = Lsl

    def __init__(self, name: str, config: LslConfig, world: World, options: FakeLslOptions) -> None:
        super().__init__(name, config, world, options)
        self.stream, self._options = config, options
        self.rate = config.rate or options.rate
        self._latency = round(config.latency * 1e9)
        picked, at = {}, 0
        for signal, entry in config.signals.items():
            n = len(entry.channels)
            picked[signal], at = Picked(np.arange(at, at + n), np.ones(n)), at + n
        self._rows, self._size = Rows(config, picked), at
        self._gap = True
        self.columns = _columns(config)
        self._truth = {signal: self._find(signal) for signal in options.signals}
        self._electrodes: SurfaceEmg | None = None
        if options.part is not None:
            self._muscles = muscles(world, f"sim.devices.{name}.part", options.part)
            channels = max(self.columns) + 1
            self._electrodes = SurfaceEmg([world.seed, zlib.crc32(name.encode())], channels, self.rate)
            self._made: dict[int, tuple[int, Array, Array]] = {}
        self.sampled(self._size, self._measure, self.rate)

    def open(self) -> None:
        super().open()
        self._gap = True

    def read(self, now: int) -> None:
        self.check_there()
        newest = self.newest()
        if newest < self._last:  # the world was restored to an earlier state
            self._last = newest - 1
        values, last = [], -1
        for number in range(max(self._last + 1, 0), newest + 1):
            sample = self.sample(number) if self.samples.keeps(number) else None
            if sample is None:
                self.health.errors += 1
                self._gap = True
            else:
                values.append(sample)
                last = number
        self._last = newest
        if not values:
            return
        good, problem = self._rows.take(self.state_arrays, np.array(values), np.ones(len(values), bool), self._gap)
        self._gap, self.health.message = False, problem
        self.health.frames += int(good.sum())
        self.health.errors += int((~good).sum())
        if good[-1]:
            self.health.stamp = now - (self.world.time - self.taken_at(last)) - self._latency

    def fill(self, values: Array, number: int) -> None:
        """Not used: `read` takes all samples, not only the newest."""

    def _find(self, signal: str) -> list[int]:
        """The rows of a signal of the world's truth, in the order of the channels."""
        place, source = f"sim.devices.{self.name}.signals.{signal}", self._options.signals[signal]
        if signal not in self.stream.signals:
            raise WiringError(place, f"the device has no signal '{signal}'", nearest(signal, self.stream.signals))
        truth = {each.name: each for each in self.world.truth}
        if source not in truth:
            raise WiringError(place, f"the world's truth has no '{source}'", nearest(source, truth))
        there, here = truth[source], tuple(self.stream.signals[signal].channels)
        if len(there.shape) != 1 or set(there.names) != set(here):
            problem = f"'{source}' has {', '.join(there.names) or 'no names'}, the signal {', '.join(here)}"
            raise WiringError(place, problem, "Give the channels the names of the world's truth")
        return [there.names.index(label) for label in here]

    def _measure(self) -> Array:
        number, at = self.samples.taken, 0
        out = np.empty(self._size)
        taken = self.taken_at(number)
        phase = 2 * math.pi * taken * 1e-9 / self._options.period
        for signal, entry in self.stream.signals.items():
            n = len(entry.channels)
            part = out[at : at + n]
            if signal in self._truth:
                part[:] = self.world.truth_arrays[self._options.signals[signal]][self._truth[signal]]
            elif self._electrodes is not None and entry.unit == "V":
                for i, muscle in enumerate(entry.channels):
                    part[i] = self._emg(number, self.columns[at + i], muscle)
            else:
                part[:] = self._options.amplitude * np.sin(phase + 0.1 * np.array(self.columns[at : at + n]))
            at += n
        if inside(self._options.nan, taken):
            out[np.array(self.columns) == self.columns[0]] = np.nan
        return out

    def _emg(self, number: int, channel: int, muscle: str) -> float:
        assert self._electrodes is not None
        block, i = divmod(number, _AT_ONCE)
        if self._made.get(channel, (-1,))[0] != block:
            self._made[channel] = (block, *self._electrodes.unit(block * _AT_ONCE, _AT_ONCE, channel))
        _, unit, noise = self._made[channel]
        strength = min(max(self._muscles.activation(muscle), 0.0), 1.0) * self._options.mvc
        return float(strength * unit[i] + self._options.floor * noise[i])


def _columns(config: LslConfig) -> list[int]:
    """The stream's channel, from 0, of each channel here: its number, or the next that is free."""
    wanted = [where for entry in config.signals.values() for where in entry.channels.values()]
    taken = {where - 1 for where in wanted if isinstance(where, int)}
    known: dict[str, int] = {}
    for where in wanted:
        if isinstance(where, str) and where not in known:
            known[where] = next(i for i in range(len(wanted) + 1024) if i not in taken)
            taken.add(known[where])
    return [where - 1 if isinstance(where, int) else known[where] for where in wanted]
