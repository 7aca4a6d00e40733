"""Buttons that reset: `reset.inputs` of the profile. A press counts, a button that is held or stuck never does."""

from __future__ import annotations

from math import isfinite

from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, LINK_STALE
from srl.runtime.loop.rate import TokenBucket
from srl.runtime.profile.graph import Graph

RELEASED = 50_000_000  # ns for which it was released before a press counts: a contact that is let go bounces, too


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
            self._inputs.append((graph.element(entry), entry.when, words))
        # ns, since when each was seen released without a break, in this stop and since its device came back; -1: not
        self._since = [-1] * len(self._inputs)
        self._old = [-1] * len(self._inputs)  # stamp of the sample that a lost device left behind
        self.pressed = -1
        self.limit = TokenBucket()

    def look(self, now: int, stopped: bool) -> None:
        """Looks for a press. Called once a cycle, once staleness is known.

        Args:
            now: ns.
            stopped: the limb is in a stop, which didn't get a new cause in this cycle.
        """
        for i, (element, when, words) in enumerate(self._inputs):
            link, stamp = words.item(DEVICE.link), words.item(DEVICE.stamp)
            if not link & LINK_CONNECTED:
                self._old[i] = stamp
            if not stopped or not link & LINK_CONNECTED or link & LINK_STALE or stamp in (-1, self._old[i]):
                self._since[i] = -1
                continue
            value = element.item()
            if value != when and isfinite(value):
                if self._since[i] < 0:
                    self._since[i] = now
                continue
            if value == when and self._since[i] >= 0 and now - self._since[i] >= RELEASED:
                self.pressed = i
            self._since[i] = -1

    def take(self) -> int:
        """Returns the index of the input that was pressed, and forgets it; -1: none."""
        taken, self.pressed = self.pressed, -1
        return taken
