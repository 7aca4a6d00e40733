"""A device of another machine in a simulated world: the world's truth under another name, or sine waves."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from srl.drivers.zenoh import Zenoh, ZenohConfig
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import AnyWorldFake, SensorOptions


class FakeZenohOptions(SensorOptions):
    """Options of the fake."""

    delay: float = Field(default=0.01, ge=0, le=0.5, description="s, from sampling to arrival")
    signals: dict[str, str] = Field(
        default_factory=dict, description="signal -> a signal of the world's truth; without one it is a sine"
    )
    amplitude: float = Field(default=0.1, ge=0, description="of the sines, in the signal's unit")
    period: float = Field(default=4.0, gt=0, description="s, of the sines")


class FakeZenoh(Sensor, AnyWorldFake):
    """Samples all signals together at `rate`; the truth is sampled when the world passes a sampling time."""

    Options = FakeZenohOptions
    real = Zenoh
    config: ZenohConfig

    def __init__(self, name: str, config: ZenohConfig, world: World, options: FakeZenohOptions) -> None:
        super().__init__(name, config, world, options)
        self._options = options
        self._rows: dict[str, list[int] | slice] = {}  # of the truth, in the signal's order
        self._check()
        self.sampled(sum(s.size for s in self.states), self._measure)

    def fill(self, values: Array, number: int) -> None:
        at = 0
        for signal in self.states:
            self.state_arrays[signal.name].reshape(-1)[:] = values[at : at + signal.size]
            at += signal.size

    def _check(self) -> None:
        names = [s.name for s in self.states]
        truth = {s.name: s for s in self.world.truth}
        for name, source in self._options.signals.items():
            place = f"sim.devices.{self.name}.signals.{name}"
            if name not in names:
                raise WiringError(place, f"the device has no signal '{name}'", nearest(name, names))
            if source not in truth:
                raise WiringError(place, f"the world's truth has no '{source}'", nearest(source, truth))
            signal = self.states[names.index(name)]
            if truth[source].shape != signal.shape:
                raise WiringError(
                    place, f"'{source}' has shape {truth[source].shape}, the signal {signal.shape}", "Correct either"
                )
            there = truth[source].labels
            if set(signal.labels) != set(there):
                raise WiringError(
                    place,
                    f"'{source}' has {', '.join(there) or 'no names'}, the signal {', '.join(signal.labels) or 'none'}",
                    "Give the signal the names of the world's truth under `labels`",
                )
            self._rows[name] = [there.index(label) for label in signal.labels] or slice(None)

    def _measure(self) -> Array:
        parts: list[Array] = []
        for signal in self.states:
            source = self._options.signals.get(signal.name)
            if source is not None and source in self.world.truth_arrays:
                parts.append(self.world.truth_arrays[source][self._rows[signal.name]].ravel())
            elif source is not None:
                parts.append(np.zeros(signal.size))
            else:
                phase = 2 * math.pi * self.taken_at(self.samples.taken) * 1e-9 / self._options.period
                parts.append(self._options.amplitude * np.sin(phase + 0.1 * np.arange(signal.size)))
        return np.concatenate(parts)
