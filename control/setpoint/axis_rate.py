"""A control value that an axis's deflection moves: rate control with a stick."""

from __future__ import annotations

from math import isfinite

from pydantic import Field, model_validator

from srl.control.setpoint.control_value import ControlValue
from srl.runtime.contracts.controller import ControllerConfig


class AxisRateConfig(ControllerConfig):
    """Options of `axis-rate`."""

    rest: float = Field(0.0, allow_inf_nan=False, description="deflection of the axis that nobody touches")
    full: float = Field(1.0, allow_inf_nan=False, description="deflection that closes at `speed`; less than rest turns")
    dead_band: float = Field(0.1, ge=0.0, allow_inf_nan=False, description="deflections so near to `rest` count as it")
    speed: float = Field(0.5, gt=0.0, allow_inf_nan=False, description="1/s, of c at full deflection")
    begin: float = Field(0.0, ge=0.0, le=1.0, description="c when the program starts")

    @model_validator(mode="after")
    def _fits(self) -> AxisRateConfig:
        if abs(self.full - self.rest) <= self.dead_band:
            raise ValueError("'full' must be farther from 'rest' than 'dead_band'")
        return self


class AxisRate(ControlValue):
    """Integrates an axis's deflection to a control value.

    Input `axis` (1,). Outputs `c` (1,), 0 to 1, and `c_rate` (1,) 1/s. Within the dead band c stands still; beyond it
    the rate begins at zero. At its limits c doesn't wind up. A reset begins at the applied value; a c that commands no
    device stays where it was. An axis that is deflected during the reset counts only after it has been at rest. While
    the input isn't finite, c is held.
    """

    Config = AxisRateConfig
    summary = "control value moved by an axis's deflection: a stick as a rate"

    def __init__(self, name: str, config: AxisRateConfig) -> None:
        super().__init__(name, config, "axis", config.begin)
        self._config = config
        self._rested = False

    def _begin(self, c: float, value: float) -> None:
        self._rested = False

    def _next(self, c: float, value: float, dt: float) -> float:
        rate = self._rate(value)
        self._rested = self._rested or rate == 0.0
        return c if rate is None or not self._rested else min(max(c + rate * dt, 0.0), 1.0)

    def _rate(self, axis: float) -> float | None:
        """The rate that the deflection asks for, 1/s; None without a deflection."""
        if not isfinite(axis):
            return None
        o = self._config
        full, off = o.full - o.rest, axis - o.rest
        if abs(off) <= o.dead_band:
            return 0.0
        share = min((abs(off) - o.dead_band) / (abs(full) - o.dead_band), 1.0)
        return o.speed * share if (off > 0.0) == (full > 0.0) else -o.speed * share
