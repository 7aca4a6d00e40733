"""One of several signals, chosen by another one with thresholds and hysteresis."""

from __future__ import annotations

from math import isfinite
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from srl.control.conditioning.element_wise import ElementWise, ElementWiseConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.per_element import Finite, NotNegative
from srl.runtime.contracts.signals import Array, Signal

_TAKEN = ("selector", "y", "chosen")


class SwitchConfig(ElementWiseConfig):
    """Options of `switch`."""

    signals: tuple[str, ...] = Field(
        ("first", "second"), min_length=2, description="names of the inputs, in the order of the selector's values"
    )
    unit: str = Field("1", description="of these inputs and the output")
    selector_unit: str = Field("1", description="of the selector")
    thresholds: tuple[Finite, ...] = Field((0.5,), description="selector_unit, rising: from each on, the next input")
    hysteresis: NotNegative = Field(0.0, description="selector_unit below a threshold at which it goes back")
    change: Literal["rate", "meet", "at-once"] = Field(
        "rate", description="rate: goes over at `catch_up`; meet: holds until the new input has come there; at-once"
    )
    near: NotNegative = Field(0.0, description="with meet, unit: an input so near to the output has come there")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(set(self.signals)) < len(self.signals) or set(self.signals) & set(_TAKEN):
            problem = f"signals: each needs a name of its own, none of {', '.join(_TAKEN)}"
            raise OptionError(problem, "Name each once, as in [manual, automatic]")
        if len(self.thresholds) != len(self.signals) - 1:
            problem = f"{len(self.thresholds)} thresholds between {len(self.signals)} signals"
            raise OptionError(problem, f"Give {len(self.signals) - 1}, one between each and the next")
        gaps = np.diff(self.thresholds)
        if not (gaps > self.hysteresis).all():
            raise OptionError("thresholds must rise, by more than `hysteresis`", "Put them farther apart")
        return self


class Switch(ElementWise):
    """Passes on one of its inputs, the one that the selector chooses.

    Inputs: `selector` (1,), and those of `signals`, (n,) each. Outputs: `y` (n,), and `chosen` (1,), the place of the
    chosen input from 0 on, NaN before there is one. While the selector isn't finite, the choice stays; that, or a
    chosen input that isn't finite, is a loss after `max_hold`. A reset chooses anew.
    """

    Config = SwitchConfig
    summary = "one of several signals, chosen by another: thresholds, hysteresis, without a jump"

    def __init__(self, name: str, config: SwitchConfig) -> None:
        super().__init__(name, config, dict.fromkeys(config.signals, config.unit), config.unit)
        self.inputs = (Signal(name="selector", shape=(1,), unit=config.selector_unit), *self.inputs)
        self.outputs = (*self.outputs, Signal(name="chosen", shape=(1,), unit="1"))
        self._signals, self._thresholds, self._config = config.signals, config.thresholds, config
        self._chosen = -1  # none
        self._met = np.zeros(config.size, bool)
        self._side = np.zeros(config.size)  # of the output on which the chosen input was

    def reset(self) -> None:
        self._chosen = -1
        self._begin(smooth=self._config.change != "at-once")
        self.output["chosen"][0] = np.nan
        self._choose()

    def update(self, dt: float) -> None:
        known = self._choose()
        if self._chosen < 0:
            self._follow(np.full(self._met.shape, np.nan), dt)
            return
        wanted = self.input[self._signals[self._chosen]]
        waited = self._unknown
        self._follow(wanted, dt, self._held(wanted) if self._config.change == "meet" else None)
        if not known:
            self._unknown = waited + dt
            self.lost = self._unknown > self._max_hold

    def _choose(self) -> bool:
        """Chooses by the selector; whether it is finite."""
        selector, bounds, i = float(self.input["selector"][0]), self._thresholds, self._chosen
        if not isfinite(selector):
            return False
        if i < 0:
            i = sum(selector >= bound for bound in bounds)
        while i < len(bounds) and selector >= bounds[i]:
            i += 1
        while i > 0 and selector < bounds[i - 1] - self._config.hysteresis:
            i -= 1
        if i != self._chosen:
            if self._config.change != "at-once":
                self._gap[:] = np.nan
            elif self._chosen >= 0:
                self._gap[:] = 0.0
            self._met[:], self._side[:] = False, 0.0
            self._chosen = self.output["chosen"][0] = i
        return True

    def _held(self, wanted: Array) -> NDArray[np.bool_]:
        """The elements whose input hasn't come to the output yet, from the one side or the other."""
        y = self.output["y"]
        seen = np.isfinite(wanted)
        off = (y - wanted)[seen]
        self._met |= np.isnan(y)
        self._met[seen] |= (np.abs(off) <= self._config.near) | (off * self._side[seen] < 0.0)
        self._side[seen] = off
        return ~self._met
