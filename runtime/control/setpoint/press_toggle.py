"""A control value that opens and closes by presses of one button (Lisini Baldi et al. 2023: the ring)."""

from __future__ import annotations

from math import isfinite

import numpy as np
from pydantic import Field

from runtime.contracts.controller import Controller, ControllerConfig
from runtime.contracts.signals import Signal


class PressToggleConfig(ControllerConfig):
    """Options of `press-toggle`."""

    speed: float = Field(1.0, gt=0.0, allow_inf_nan=False, description="1/s, of c")
    begin: float = Field(0.0, ge=0.0, le=1.0, description="c when the program starts")


class PressToggle(Controller):
    """Each press turns round where a control value goes: to 1, then to 0.

    Input `presses` (1,): a count that rises by one a press, or a button's level. Outputs `c` (1,), 0 to 1, and `c_rate`
    (1,) 1/s. A reset begins at the applied value; a c that commands no device stays where it was. There c stands still
    until a press, which sends it to the farther end. What was pressed up to the reset, and a count that falls (the
    device started again), are no presses. While the input isn't finite, c is held.
    """

    Config = PressToggleConfig
    summary = "control value that opens and closes by presses of a button"

    def __init__(self, name: str, config: PressToggleConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="presses", shape=(1,), unit="1"),)
        self.outputs = (Signal(name="c", shape=(1,), unit="1"), Signal(name="c_rate", shape=(1,), unit="1/s"))
        self._speed = config.speed
        self._c = self._target = config.begin
        self._seen: float | None = None

    def reset(self) -> None:
        if "c" in self.applied:
            self._c = float(np.clip(self.applied["c"][0], 0.0, 1.0))
        self._target = self._c
        self._seen = None
        self._presses()
        self.output["c"][0], self.output["c_rate"][0] = self._c, 0.0

    def update(self, dt: float) -> None:
        last, presses = self._c, self._presses()
        if presses is not None:
            if presses % 2:
                # After a reset c may stand anywhere; later the target is one of the ends.
                self._target = 0.0 if self._target > 0.5 else 1.0
            step = self._speed * dt
            self._c = min(max(self._target, last - step), last + step)
        self.output["c"][0], self.output["c_rate"][0] = self._c, (self._c - last) / dt

    def _presses(self) -> int | None:
        """The number of presses since the last call; None if the input isn't finite."""
        count = float(self.input["presses"][0])
        if not isfinite(count):
            return None
        seen, self._seen = self._seen, count
        return 0 if seen is None else max(round(count - seen), 0)
