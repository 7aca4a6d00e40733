"""Laws and guards side by side: the Python one and the C one, with the same inputs."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest

from srl.runtime.contracts import compiled as module
from srl.runtime.contracts.compiled import Compiled, compiled
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array

needs_c = pytest.mark.skipif(bool(module.missing()), reason=f"no C to compare with: {module.missing()}")
# From 3.12 on `sum` rounds once at its end, which C doesn't imitate.
EXACT = sys.version_info < (3, 12)
ODD = (np.nan, np.inf, -np.inf, 5e-324, -1e-310, 1e99, 1e200, -0.0)  # a denormal or two among them


class Pair:
    """Two laws of one kind with inputs that are always the same.

    Attributes:
        python, c: the laws; `fast` computes the second one.
    """

    def __init__(self, make: Callable[[], Controller]) -> None:
        self.python, self.c = make(), make()
        self.fast: Compiled = compiled(self.c)

    def give(self, name: str, value: object, of: str = "input") -> None:
        """Sets an input of both; `of`: or "applied", "param"."""
        for law in (self.python, self.c):
            getattr(law, of)[name][...] = value

    def reset(self) -> None:
        """Both."""
        with np.errstate(all="ignore"):
            self.python.reset()
            self.fast.reset()

    def step(self, dt: float) -> None:
        """`update` of both, which fail alike, if they do: the loop stops the limb then."""
        outcomes = []
        for update in (self.python.update, self.fast.update):
            try:
                with np.errstate(all="ignore"):
                    update(dt)
                outcomes.append("")
            except (ValueError, OverflowError, ZeroDivisionError) as error:
                outcomes.append(type(error).__name__)
        assert outcomes[0] == outcomes[1], outcomes

    def gap(self) -> float:
        """The largest difference of an output, as a share of that output's greatest element; inf: NaNs differ."""
        return max(difference(self.python.output[name], self.c.output[name]) for name in self.python.output)

    def same_bits(self) -> bool:
        """Whether all outputs are the same."""
        return all(bits(self.python.output[name]) == bits(self.c.output[name]) for name in self.python.output)


def bits(array: Array) -> bytes:
    """An array's bytes. Any NaN is like any other."""
    return np.where(np.isnan(array), np.nan, array).tobytes()


def difference(a: Array, b: Array) -> float:
    """The largest difference as a share of the greatest element of `a`; inf where one alone isn't a number."""
    odd = ~np.isfinite(a)
    if (odd != ~np.isfinite(b)).any():
        return float("inf")
    if odd.all():
        return 0.0
    scale = float(np.abs(a[~odd]).max())
    return float(np.abs(a[~odd] - b[~odd]).max()) / scale if scale > 0.0 else float(np.abs(b[~odd]).max())
