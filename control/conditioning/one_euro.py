"""The 1 euro filter: a low-pass whose cutoff rises with the signal's speed.

Source: Casiez, Roussel, Vogel, 1 Euro Filter: A Simple Speed-based Low-pass Filter for Noisy Input in Interactive
Systems, CHI 2012, algorithm 1. The speed is that of the sample from the last filtered value, as there; the authors'
programs of today take the last sample instead.
"""

from __future__ import annotations

from math import tau
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.conditioning.element_wise import Each, ElementWise, ElementWiseConfig
from srl.runtime.contracts.errors import OptionError


class OneEuroConfig(ElementWiseConfig):
    """Options of `one-euro`."""

    unit: str = Field("1", description="of the input and the output")
    min_cutoff: Each = Field(1.0, description="Hz, of a signal at rest: less shakes less")
    beta: Each = Field(0.0, description="Hz for each unit a second: more lags less in fast motion")
    d_cutoff: Each = Field(1.0, description="Hz, of the signal's speed")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for key in ("min_cutoff", "d_cutoff"):
            if (self.each(key) <= 0.0).any():
                raise OptionError(f"{key}: it isn't above 0", "Give a frequency in Hz")
        if (self.each("beta") < 0.0).any():
            raise OptionError("beta: it is below 0", "Give 0 or more")
        return self


class OneEuro(ElementWise):
    """Filters each element: x^ += a (x - x^), a = dt / (dt + 1 / (2 pi f)), f = min_cutoff + beta |v^|.

    v^ is the speed (x - x^) / dt through a low-pass of its own, with `d_cutoff`. Input `x` (n,), output `y` (n,) in the
    same unit. A sample after a pause counts with the whole pause as its dt, as any late sample. A reset begins at the
    present sample. Not for angles that jump by a turn, nor for the numbers of a quaternion.
    """

    Config = OneEuroConfig
    summary = "1 euro filter: smooth at rest, quick in motion (Casiez 2012)"

    def __init__(self, name: str, config: OneEuroConfig) -> None:
        super().__init__(name, config, {"x": config.unit}, config.unit)
        self._min, self._beta, self._d = map(config.each, ("min_cutoff", "beta", "d_cutoff"))
        self._x = np.full(config.size, np.nan)  # x^; NaN: no sample yet
        self._v = np.zeros(config.size)  # v^, unit/s
        self._dt = np.zeros(config.size)  # s since the last sample

    def reset(self) -> None:
        self._x[:] = np.nan
        self._v[:] = self._dt[:] = 0.0
        self._begin()

    def update(self, dt: float) -> None:
        x = self.input["x"]
        self._dt += dt
        first = np.isnan(self._x) & np.isfinite(x)
        self._x[first] = x[first]
        with np.errstate(invalid="ignore", over="ignore"):  # what isn't finite isn't taken
            off = x - self._x
            # a dx of the speed's low-pass, without a division by dt, which may be 0.
            share = self._dt + 1.0 / (tau * self._d)
            v = self._v + (off - self._dt * self._v) / share
            new = self._x + off * self._dt / (self._dt + 1.0 / (tau * (self._min + self._beta * np.abs(v))))
        taken = np.isfinite(new) & np.isfinite(v)
        self._x[taken], self._v[taken], self._dt[taken] = new[taken], v[taken], 0.0
        self._follow(np.where(taken, self._x, np.nan), dt)
