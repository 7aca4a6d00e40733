"""Numbers that a client has changed are followed gradually, so that a change makes no step in a command."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf

from srl.runtime.contracts.signals import Array


class Ramps:
    """Live parameters of a law as it takes them: they go to the clients' values at a bounded rate.

    Attributes:
        values: by name; after a reset those that the clients have set.
    """

    def __init__(self, *names: str, rate: float) -> None:
        """rate: in a second, by at most so much."""
        self._names, self._rate = names, rate
        self.values = dict.fromkeys(names, 1.0)

    def reset(self, param: Mapping[str, Array]) -> None:
        """Takes the values at once: the law starts at rest."""
        for name in self._names:
            self.values[name] = param[name].item()

    def update(self, param: Mapping[str, Array], dt: float, rising: float = inf) -> bool:
        """Goes on for dt seconds; returns whether anything changed.

        `rising`: in a second, the rate at most at which the first of them grows.
        """
        changed = False
        for i, name in enumerate(self._names):
            value, wanted = self.values[name], param[name].item()
            if value != wanted:
                up = min(self._rate, rising) if i == 0 else self._rate
                self.values[name] = min(max(wanted, value - dt * self._rate), value + dt * up)
                changed = True
        return changed
