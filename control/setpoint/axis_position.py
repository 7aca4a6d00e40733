"""A control value from how far an axis is deflected: position control with a stick, a trigger or a held button."""

from __future__ import annotations

from math import isfinite
from typing import Final

from pydantic import Field, model_validator

from srl.control.setpoint.control_value import ControlValue
from srl.runtime.contracts.controller import ControllerConfig

_NEAR: Final = 0.05  # of c, how near the axis meets it


class AxisPositionConfig(ControllerConfig):
    """Options of `axis-position`."""

    lower: float = Field(0.0, allow_inf_nan=False, description="deflection at which c is 0")
    upper: float = Field(1.0, allow_inf_nan=False, description="deflection at which c is 1; may be less than `lower`")
    rest: float = Field(0.0, allow_inf_nan=False, description="deflection of the axis that nobody touches")
    dead_band: float = Field(0.0, ge=0.0, allow_inf_nan=False, description="deflections so near to `rest` count as it")
    speed: float = Field(5.0, gt=0.0, allow_inf_nan=False, description="1/s, of c")

    @model_validator(mode="after")
    def _fits(self) -> AxisPositionConfig:
        low, high = sorted((self.lower, self.upper))
        if low == high:
            raise ValueError("'lower' and 'upper' must differ")
        if not low <= self.rest <= high:
            raise ValueError("'rest' must be within 'lower' and 'upper'")
        if any(0.0 < side <= self.dead_band for side in (self.rest - low, high - self.rest)):
            raise ValueError("'dead_band' must leave some range on each side of 'rest'")
        return self


class AxisPosition(ControlValue):
    """Converts an axis's deflection to a control value.

    Input `axis` (1,). Outputs `c` (1,), 0 to 1, and `c_rate` (1,) 1/s. Beyond the dead band the deflection is
    stretched, so that c is continuous and reaches its ends. c follows at `speed` at most, from the applied value after
    a reset; a c that commands no device stays where it was. After a reset c stays until the axis has met it: a trigger
    that was pulled or let go meanwhile moves nothing by itself. While the input isn't finite, c is held.
    """

    Config = AxisPositionConfig
    summary = "control value from an axis's deflection: a stick, a trigger, a button while held"

    def __init__(self, name: str, config: AxisPositionConfig) -> None:
        self._config = config
        super().__init__(name, config, "axis", self._wanted(config.rest))
        self._met, self._side = False, 0.0  # whether the axis has met c since the reset; on which side of it it was

    def _begin(self, c: float, value: float) -> None:
        self._met, self._side = False, 0.0

    def _next(self, c: float, value: float, dt: float) -> float:
        if not isfinite(value) or not self._meets(c, self._wanted(value)):
            return c
        step = self._config.speed * dt
        return min(max(self._wanted(value), c - step), c + step)

    def _meets(self, c: float, wanted: float) -> bool:
        """Whether the axis has been at c, or on both sides of it, since the reset."""
        off = wanted - c
        self._met = self._met or abs(off) <= _NEAR or off * self._side < 0.0
        self._side = off
        return self._met

    def _wanted(self, axis: float) -> float:
        o = self._config
        low, high = sorted((o.lower, o.upper))
        off = min(max(axis, low), high) - o.rest
        if abs(off) <= o.dead_band:
            off = 0.0
        else:
            full = (high if off > 0.0 else low) - o.rest
            off = full * (abs(off) - o.dead_band) / (abs(full) - o.dead_band)
        return min(max((o.rest + off - o.lower) / (o.upper - o.lower), 0.0), 1.0)
