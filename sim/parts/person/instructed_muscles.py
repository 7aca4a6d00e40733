"""The cell's part `muscles`: muscles of a person who contracts one at a time, as told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Contract, Instruction, Rest
from srl.sim.world.part import Mjcf, Part, PartConfig

_TREMOR: Final = (1.3, 2.9)  # Hz, of a contraction that isn't quite steady; ours
_FADED: Final = 20.0  # lags, after which nothing is left of what was before


@dataclass(frozen=True)
class _Instructed:
    """From `since` s on, contracts a muscle ("": none) with this strength."""

    muscle: str
    strength: float
    since: float


class MusclesConfig(PartConfig):
    """Options of the part."""

    effort: float = Field(0.97, gt=0, le=1, description="mean of a contraction that is told, 1: the greatest; ours")
    spread: float = Field(0.02, ge=0, le=0.5, description="standard deviation of it, from one to the next; ours")
    tremor: float = Field(0.02, ge=0, le=0.3, description="amplitude, as a share of the contraction; ours")
    tone: float = Field(0.002, ge=0, le=0.2, description="of a muscle at rest; ours")
    others: float = Field(0.1, ge=0, le=1, description="what all other muscles do meanwhile, as a share of it; ours")
    reaction: float = Field(0.3, ge=0, le=2, description="s, from being told to the onset")
    lag: float = Field(0.15, gt=0, le=1, description="s, time constant of rise and fall")
    mistaken: dict[str, str] = Field(default_factory=dict, description="contracts this muscle when told another one")


class MusclesPart(Part):
    """Nothing but activations: an EMG device measures them (`sim.devices.NAME.part`)."""

    Config = MusclesConfig
    summary = "muscles of a person who contracts one at a time, as told"

    def __init__(self, name: str, config: MusclesConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        self.wearer = self
        self._data: Any = None
        self._given = [_Instructed("", 0.0, -1e9)]

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        """It has no body."""

    def bind(self, model: Any, data: Any) -> None:
        self._data = data

    def activation(self, muscle: str) -> float:
        """The present activation, 0 to 1, of the muscle of any name."""
        return self._at(muscle, float(self._data.time), len(self._given) - 1)

    def _at(self, muscle: str, t: float, number: int) -> float:
        """The activation at t s, if what was told last is `number`."""
        config, instructed = self._config, self._given[number]
        if not number:
            return config.tone
        late = t - instructed.since - config.reaction
        # What was told before goes on until the reaction to this, and fades with the lag.
        begins = instructed.since + min(max(late, -config.reaction), 0.0) + config.reaction
        before = self._at(muscle, begins, number - 1) if late < _FADED * config.lag else 0.0
        if late <= 0.0:
            return before
        goal = config.tone
        if instructed.muscle:
            goal = instructed.strength * (1.0 if muscle == instructed.muscle else config.others)
            goal *= 1.0 + 0.5 * config.tremor * sum(np.sin(2.0 * np.pi * f * t) for f in _TREMOR)
        return float(np.clip(goal + (before - goal) * exp(-late / config.lag), 0.0, 1.0))

    # -- the wearer, as who instructs it knows it

    @property
    def done(self) -> bool:
        """Whether what was told last is reached."""
        return bool(self._data.time >= self._given[-1].since + self._config.reaction + 4.0 * self._config.lag)

    def instruct(self, instruction: Instruction) -> None:
        """From now on contracts one muscle, or relaxes all. Raises ValueError: muscles alone can't do it."""
        if not isinstance(instruction, Rest | Contract):
            raise ValueError(f"muscles aren't told to {type(instruction).__name__}: Contract or Rest")
        muscle = ""
        if isinstance(instruction, Contract):
            muscle = self._config.mistaken.get(instruction.muscle, instruction.muscle)
        now = float(self._data.time)
        random = np.random.default_rng((self.seed, len(self._given)))
        strength = float(np.clip(random.normal(self._config.effort, self._config.spread), 0.05, 1.0))
        self._given.append(_Instructed(muscle, strength, now))

    def see(self, pointers: Any) -> None:
        """Muscles see nothing."""

    def fill(self, truth: Mapping[str, Array]) -> None:
        """It has no truth signal: what it does is told, and the device measures it."""

    def save(self) -> Array:
        return np.array([len(self._given)], float)

    def restore(self, state: Array) -> None:
        del self._given[int(state[0]) :]
