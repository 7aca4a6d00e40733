"""What every law that makes a control value of its own has: the outputs, and where it begins."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Signal


class ControlValue(Controller):
    """A law with one input (1,) and the outputs `c` (1,), 0 to 1, and `c_rate` (1,) 1/s.

    A reset begins at the applied value; a c that commands no device stays where it was. A law says in `_begin` what
    else begins at a reset, and in `_next` where c is next.
    """

    def __init__(self, name: str, config: ControllerConfig, source: str, begin: float) -> None:
        """`source`: name of the input. `begin`: c when the program starts."""
        super().__init__(name, config)
        self.inputs = (Signal(name=source, shape=(1,), unit="1"),)
        self.outputs = (Signal(name="c", shape=(1,), unit="1"), Signal(name="c_rate", shape=(1,), unit="1/s"))
        self._source = source
        self._c = begin

    def reset(self) -> None:
        if "c" in self.applied:
            self._c = float(np.clip(self.applied["c"][0], 0.0, 1.0))
        self._begin(self._c, float(self.input[self._source][0]))
        self.output["c"][0], self.output["c_rate"][0] = self._c, 0.0

    def update(self, dt: float) -> None:
        last = self._c
        self._c = self._next(last, float(self.input[self._source][0]), dt)
        self.output["c"][0], self.output["c_rate"][0] = self._c, (self._c - last) / dt

    @abstractmethod
    def _begin(self, c: float, value: float) -> None:
        """A reset at c, with the input's value, which may be not finite."""

    @abstractmethod
    def _next(self, c: float, value: float, dt: float) -> float:
        """Where c is dt s later, 0 to 1."""
