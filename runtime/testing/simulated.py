"""Runs a whole profile on its fakes in the test's own process, as fast as it goes, and keeps every row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import State
from srl.runtime.ipc.layout import Layout
from srl.runtime.testing.given import Given
from srl.runtime.testing.lab import Lab


@dataclass(frozen=True)
class Simulated:
    """The result of a simulated run, row by row.

    Attributes:
        layout: the signals' names, shapes and units.
        rows: (k, width) int64, as a recording holds them.
        events: the loop's events, as text.
    """

    layout: Layout
    rows: NDArray[np.int64]
    events: list[str]

    def value(self, signal: str) -> Array:
        """The values `(k, *shape)` of a signal in every cycle, e.g. "finger.position_command.applied"."""
        return self.layout.value(self.rows, signal)

    def states(self) -> list[State]:
        """The state of the state machine in every cycle."""
        return [State(int(state)) for state in self.layout.header(self.rows, "state")]


def simulate(given: Given, seconds: float) -> Simulated:
    """Runs a profile with all its devices simulated: without service or clock, as fast as possible.

    Args:
        given: the profile: its YAML, its path, its name or its keys.
        seconds: duration in world time.
    Raises:
        ProfileError, WiringError: with the same text as from `srl check`.
    """
    with Lab(given) as lab:
        lab.run(seconds)
        return Simulated(lab.layout, lab.rows, lab.events)
