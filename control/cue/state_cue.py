"""A cue as the limb begins to follow."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.cue import Cue
from srl.runtime.contracts.signals import Signal


class StateCueConfig(ControllerConfig):
    """Options of `state-cue`."""

    motors: tuple[str, ...] = Field(min_length=1, description="labels of the output")
    begin: Cue = Field(Cue(pulses=1), description="given as the limb begins to follow")


class StateCue(Controller):
    """Some pulses after each reset, when the limb begins to follow; then nothing.

    Output `intensity` (n,), 0 to 1. No law runs in a stop: what is felt as one begins is the guard's `stop_cue` and
    `loss_cue`.
    """

    Config = StateCueConfig
    summary = "a cue for the wearer as the limb begins to follow"

    def __init__(self, name: str, config: StateCueConfig) -> None:
        super().__init__(name, config)
        n = len(config.motors)
        self.outputs = (Signal(name="intensity", shape=(n,), unit="1", labels=config.motors),)
        self._begin, self._time = config.begin, 0.0

    def reset(self) -> None:
        self._time = 0.0
        self.output["intensity"][:] = 0.0

    def update(self, dt: float) -> None:
        self.output["intensity"][:] = self._begin.at(self._time)
        self._time += dt

    def warnings(self, dt: float) -> Iterator[tuple[str, str]]:
        """A cue that is too short for the cycles."""
        if text := self._begin.too_short(dt):
            yield "begin", text
