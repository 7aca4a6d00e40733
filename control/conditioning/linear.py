"""A signal scaled and moved: gain, offset, dead band, and ranges."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.conditioning.element_wise import Each, ElementWise, ElementWiseConfig
from srl.runtime.contracts.errors import OptionError


class LinearConfig(ElementWiseConfig):
    """Options of `linear`."""

    in_unit: str = Field("1", description="of the input")
    out_unit: str = Field("1", description="of the output")
    gain: Each = Field(1.0, description="out_unit for each in_unit; negative turns it round")
    offset: Each = Field(0.0, description="out_unit: the output for an input at rest")
    rest: Each = Field(0.0, description="in_unit: the middle of the dead band")
    dead_band: Each = Field(0.0, description="in_unit: inputs so near to `rest` count as it")
    in_lower: Each | None = Field(None, description="in_unit: lesser inputs count as this")
    in_upper: Each | None = Field(None, description="in_unit: greater inputs count as this")
    out_lower: Each | None = Field(None, description="out_unit: the least output")
    out_upper: Each | None = Field(None, description="out_unit: the greatest output")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for key in ("gain", "offset", "rest"):
            self.each(key)
        if (self.each("dead_band") < 0.0).any():
            raise OptionError("dead_band: it is below 0", "Give 0 or more")
        self.range_of("in_lower", "in_upper")
        self.range_of("out_lower", "out_upper")
        return self


class Linear(ElementWise):
    """y = offset + gain d(x - rest), where d takes the dead band away: d(e) = sign(e) max(|e| - dead_band, 0).

    Input `x` (n,) in `in_unit`, output `y` (n,) in `out_unit`. The input is kept in its range before, the output after.
    """

    Config = LinearConfig
    summary = "a signal with gain, offset, dead band and ranges"

    def __init__(self, name: str, config: LinearConfig) -> None:
        super().__init__(name, config, {"x": config.in_unit}, config.out_unit)
        self._gain, self._offset, self._rest, self._band = map(config.each, ("gain", "offset", "rest", "dead_band"))
        self._within = config.range_of("in_lower", "in_upper")
        self._range = config.range_of("out_lower", "out_upper")

    def reset(self) -> None:
        self._begin()

    def update(self, dt: float) -> None:
        x = self.input["x"]
        off = np.clip(np.where(np.isfinite(x), x, np.nan), *self._within) - self._rest
        off -= np.clip(off, -self._band, self._band)
        self._follow(np.clip(self._offset + self._gain * off, *self._range), dt)
