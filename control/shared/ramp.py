"""Factors that a client may change in a run: a law follows them gradually, so no change makes a step in a command."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import Final

from srl.runtime.contracts.controller import Parameter
from srl.runtime.contracts.signals import Array

QUICKEST: Final = 1.0  # 1/s, of a factor that a client has changed


def factor(name: str, lower: float, upper: float, text: str) -> Parameter:
    """A live parameter that multiplies something: 1 by default. `text`: what it does."""
    return Parameter(name=name, default=1.0, lower=lower, upper=upper, unit="1", text=text)


class Ramps:
    """A law's factors as it takes them: they go to the clients' values at a bounded rate.

    Attributes:
        parameters: the law's live parameters.
        values: by name; after a reset those that the clients have set.
    """

    def __init__(self, *parameters: Parameter, rate: float = QUICKEST) -> None:
        """rate: in a second, by at most so much."""
        self.parameters, self._rate = parameters, rate
        self._names = tuple(each.name for each in parameters)
        self.values = dict.fromkeys(self._names, 1.0)

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
