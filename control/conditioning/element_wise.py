"""What general laws share: labels, units, and an output that neither jumps nor outlives what it follows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.per_element import Finite, in_order
from srl.runtime.contracts.signals import Array, Signal

Each = dict[str, Finite] | Finite
"""An option with one number for all elements, or one for each by its label."""


class ElementWiseConfig(ControllerConfig):
    """Options of every law of this kind."""

    labels: tuple[str, ...] = Field((), description="of the elements; left out: one element")
    max_hold: float = Field(0.5, ge=0.0, description="s for which an unknown input is waited for; .inf: for ever")
    catch_up: float = Field(
        1.0, gt=0.0, allow_inf_nan=False,
        description="the output's unit in a second: how fast what is left after a reset or a hold goes to zero",
    )  # fmt: skip

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        if len(set(self.labels)) < len(self.labels):
            raise OptionError("labels: a label is there more than once", "Name each once")
        return self

    @property
    def size(self) -> int:
        """Number of elements."""
        return len(self.labels) or 1

    def each(self, key: str) -> Array:
        """(n,) the values of an option in the order of the labels. Raises OptionError."""
        try:
            return np.array(in_order(getattr(self, key), self.labels, size=self.size), dtype=float)
        except OptionError as error:
            raise OptionError(f"{key}: {error.problem}", error.remedy) from None

    def range_of(self, lower: str, upper: str) -> tuple[Array, Array]:
        """(n,) each, the values of two options, None for no bound. Raises OptionError: a range is empty."""
        low, high = (
            np.full(self.size, none) if getattr(self, key) is None else self.each(key)
            for key, none in ((lower, -np.inf), (upper, np.inf))
        )
        if not (low < high).all():
            raise OptionError(f"'{lower}' isn't below '{upper}'", "Give two ends with a range between them")
        return low, high


class ElementWise(Controller):
    """A law with the output `y` (n,), which follows a wanted value, each element by itself.

    While the wanted value isn't finite, the output stays; after `max_hold` that is a loss. If the output commands a
    device, nothing jumps: after a reset or a hold the difference to the wanted value goes to zero at `catch_up`.
    Elsewhere the output is NaN until there is a value.
    """

    def __init__(self, name: str, config: ElementWiseConfig, inputs: Mapping[str, str], unit: str) -> None:
        """`inputs`: the unit of each input (n,), by name. `unit`: that of the output."""
        super().__init__(name, config)
        n, labels = config.size, config.labels
        self.inputs = tuple(Signal(name=i, shape=(n,), unit=u, labels=labels) for i, u in inputs.items())
        self.outputs = (Signal(name="y", shape=(n,), unit=unit, labels=labels),)
        self._max_hold, self._catch_up = config.max_hold, config.catch_up
        self._gap = np.full(n, np.nan)  # of the output from what is wanted; NaN: held
        self._smooth = True
        self._unknown = 0.0  # s

    def _begin(self, smooth: bool = False) -> None:
        """Restarts from the applied output. `smooth`: nothing jumps, though no device may be commanded."""
        self._smooth = smooth or "y" in self.applied
        self.output["y"][:] = self.applied.get("y", np.nan)
        self._gap[:] = np.nan
        self._unknown, self.lost = 0.0, False

    def _follow(self, wanted: Array, dt: float, held: NDArray[np.bool_] | None = None) -> None:
        """Goes on for dt s towards `wanted` (n,). `held` (n,): elements that stay, which is no loss."""
        y, gap = self.output["y"], self._gap
        known = np.isfinite(wanted)
        free = known if held is None else known & ~held
        gap[~free] = np.nan
        picked_up = free & np.isnan(gap)
        gap[picked_up] = np.nan_to_num(y - wanted)[picked_up] if self._smooth else 0.0
        step = self._catch_up * dt
        gap -= np.clip(gap, -step, step)
        y[free] = (wanted + gap)[free]
        self._unknown = 0.0 if known.all() else self._unknown + dt
        self.lost = self._unknown > self._max_hold
