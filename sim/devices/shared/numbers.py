"""The fake of a device of plain numbers: the world's truth by name, or sine waves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from srl.drivers.numbers.signals import Numbers, NumbersConfig
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import AnyWorldFake, SensorOptions


class FakeNumbersOptions(SensorOptions):
    """Options of the fake. `rate` counts where the device's own is 0."""

    truth: dict[str, str] = Field(
        default_factory=dict, description="signal -> a signal of the world's truth; without one it is a wave"
    )
    low: float = Field(default=0.0, description="of the waves, in the signal's unit")
    high: float = Field(default=1.0, description="of the waves, in the signal's unit")
    period: float = Field(default=4.0, gt=0, description="s, of the waves")


class FakeNumbers(Sensor, AnyWorldFake):
    """All numbers are taken together, at the device's rate.

    Attributes:
        numbers: of the profile.
    """

    Options = FakeNumbersOptions

    def __init__(self, name: str, config: NumbersConfig, world: World, options: FakeNumbersOptions) -> None:
        super().__init__(name, config, world, options)
        self.numbers, self._options, self._signals = Numbers(config), options, config.signals
        self.latency = round(config.latency * 1e9)
        self._rows = {signal: self._find(signal) for signal in options.truth}
        self.sampled(len(self.numbers.places), self._measure, config.rate or options.rate)

    def fill(self, values: Array, number: int) -> bool:
        problem = self.numbers.take(self.numbers.numbers(values), self.state_arrays)
        self.health.message = problem
        self.health.errors += bool(problem)
        return not problem

    def _find(self, signal: str) -> list[int]:
        """The rows of a signal of the world's truth, in the order of the elements."""
        place, source = f"sim.devices.{self.name}.truth.{signal}", self._options.truth[signal]
        if signal not in self._signals:
            raise WiringError(place, f"the device has no signal '{signal}'", nearest(signal, self._signals))
        truth = {each.name: each for each in self.world.truth}
        if source not in truth:
            raise WiringError(place, f"the world's truth has no '{source}'", nearest(source, truth))
        there, here = truth[source], tuple(self._signals[signal].elements)
        if len(there.shape) != 1 or not set(here) <= set(there.names):
            problem = f"'{source}' has {', '.join(there.names) or 'no names'}, the signal {', '.join(here)}"
            raise WiringError(place, problem, "Give the elements the names of the world's truth")
        return [there.names.index(label) for label in here]

    def _measure(self) -> Array:
        taken = self.taken_at(self.samples.taken) * 1e-9
        options, parts = self._options, list[Any]()
        for signal, entry in self._signals.items():
            if signal in self._rows:
                parts.append(self.world.truth_arrays[options.truth[signal]][self._rows[signal]])
                continue
            phase = 2 * math.pi * taken / options.period + 0.5 * np.arange(len(entry.elements))
            wave = options.low + (options.high - options.low) * 0.5 * (1.0 - np.cos(phase))
            parts.append(np.clip(wave, entry.lower, entry.upper))
        return np.concatenate(parts)
