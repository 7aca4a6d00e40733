"""The conformance tests of control laws: a class to derive from, in one's own tests.

class TestFollow(ControllerConformance):
    inputs, start = {"lever": [0.3]}, {"q": [0.1]}

    def law(self):
        return bound(LeverToJoint("follow", LeverToJointConfig()))
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array
from srl.runtime.testing import controller_rules

Values = Mapping[str, Sequence[float] | Array]
_NONE: Values = MappingProxyType({})


class ControllerConformance:
    """Every rule for a control law.

    Attributes:
        inputs: values for its inputs, by name, in their shapes and units.
        start: where the commanded outputs are at the reset, by output name; an output that isn't named may jump.
    """

    inputs: Values = _NONE
    start: Values = _NONE

    def law(self) -> Controller:
        """Makes a new law, bound. A class must say how."""
        raise NotImplementedError(f"{type(self).__name__} must have a method `law` that returns a new, bound law")

    def test_it_names_its_elements(self) -> None:
        controller_rules.names_its_elements(self.law())

    def test_it_starts_where_the_limb_is(self) -> None:
        controller_rules.starts_where_the_limb_is(self.law(), *self._given())

    def test_it_stays_finite(self) -> None:
        controller_rules.stays_finite(self.law(), *self._given())

    def test_it_recovers_from_nan(self) -> None:
        controller_rules.recovers_from_nan(self.law(), *self._given())

    def test_it_repeats_exactly(self) -> None:
        controller_rules.repeats_exactly(self.law(), *self._given(), other=self.law())

    def test_it_writes_only_its_outputs(self) -> None:
        controller_rules.writes_only_its_outputs(self.law(), *self._given())

    def _given(self) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
        inputs, start = ({k: np.asarray(v, float) for k, v in given.items()} for given in (self.inputs, self.start))
        return inputs, start
