"""Buttons that reset: `reset.inputs` of the profile. A press counts, a button that is held or stuck never does."""

from __future__ import annotations

from math import isfinite

from runtime.ipc.words import DEVICE, LINK_CONNECTED, LINK_STALE
from runtime.loop.rate import TokenBucket
from runtime.profile.graph import Graph


class ResetInputs:
    """Finds presses; reads only the row.

    Attributes:
        pressed: index of the input whose press waits for the next cycle; -1: none.
        limit: how many presses may ask.
    """

    def __init__(self, graph: Graph) -> None:
        self._inputs = []
        for entry in graph.profile.reset.inputs:
            words = graph.row.devices[graph.layout.devices.index(entry.signal.partition(".")[0])]
            element = graph.row.views[entry.signal].reshape(-1)[entry.index : entry.index + 1]
            self._inputs.append((element, entry.when, words))
        # Whether each was seen released since the stop began and since its device came back.
        self._released = [False] * len(self._inputs)
        self.pressed = -1
        self.limit = TokenBucket()

    def look(self, stopped: bool) -> None:
        """Looks for a press. `stopped`: the limb is in a stop. Called once a cycle, once staleness is known."""
        for i, (element, when, words) in enumerate(self._inputs):
            link = words.item(DEVICE.link)
            if not stopped or not link & LINK_CONNECTED or link & LINK_STALE or words.item(DEVICE.stamp) < 0:
                self._released[i] = False
                continue
            value = element.item()
            if value != when:
                self._released[i] |= isfinite(value)
            elif self._released[i]:
                self._released[i], self.pressed = False, i

    def take(self) -> int:
        """Returns the index of the input that was pressed, and forgets it; -1: none."""
        taken, self.pressed = self.pressed, -1
        return taken
