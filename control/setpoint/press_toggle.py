"""A control value that opens and closes by presses of one button (Lisini Baldi et al. 2023: the ring)."""

from __future__ import annotations

from math import isfinite

from pydantic import Field

from srl.control.setpoint.control_value import ControlValue
from srl.runtime.contracts.controller import ControllerConfig


class PressToggleConfig(ControllerConfig):
    """Options of `press-toggle`."""

    speed: float = Field(1.0, gt=0.0, allow_inf_nan=False, description="1/s, of c")
    begin: float = Field(0.0, ge=0.0, le=1.0, description="c when the program starts")


class PressToggle(ControlValue):
    """Each press turns round where a control value goes: to 1, then to 0.

    Input `presses` (1,): a count that rises by one a press, or a button's level. Outputs `c` (1,), 0 to 1, and `c_rate`
    (1,) 1/s. A reset begins at the applied value; a c that commands no device stays where it was. There c stands still
    until a press, which sends it to the farther end. What was pressed up to the reset, and a count that falls (the
    device started again), are no presses. While the input isn't finite, c is held.
    """

    Config = PressToggleConfig
    summary = "control value that opens and closes by presses of a button"

    def __init__(self, name: str, config: PressToggleConfig) -> None:
        super().__init__(name, config, "presses", config.begin)
        self._speed = config.speed
        self._target = config.begin
        self._seen: float | None = None

    def _begin(self, c: float, value: float) -> None:
        self._target = c
        self._seen = None
        self._presses(value)

    def _next(self, c: float, value: float, dt: float) -> float:
        presses = self._presses(value)
        if presses is None:
            return c
        if presses % 2:
            # After a reset c may stand anywhere; later the target is one of the ends.
            self._target = 0.0 if self._target > 0.5 else 1.0
        step = self._speed * dt
        return min(max(self._target, c - step), c + step)

    def _presses(self, count: float) -> int | None:
        """The number of presses since the last call; None if the input isn't finite."""
        if not isfinite(count):
            return None
        seen, self._seen = self._seen, count
        return 0 if seen is None else max(round(count - seen), 0)
