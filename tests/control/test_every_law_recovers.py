"""Each law of the profiles that come with srl, as it stands there: an input that was NaN leaves nothing behind."""

from __future__ import annotations

import numpy as np
import pytest

from srl.control.skeleton.collision import Collision
from srl.runtime.profile import library
from srl.runtime.testing.controller_rules import recovers_from_nan
from srl.testing import Lab

BY_PERSON = {"base-jog", "finger-jog", "hand-jog", "panda-jog", "servo-jog", "so101", "strap-jog", "ur-jog"}


@pytest.mark.slow
@pytest.mark.parametrize("name", library.shipped())
def test_an_input_that_was_nan_leaves_nothing_behind(name: str) -> None:
    with Lab(name) as run:
        if name not in BY_PERSON:  # no client commands these
            run.until("active")
        run.run(1.0)
        for law in (each.controller for each in run._graph.laws):
            # NaN: a setpoint that no client has sent yet.
            inputs = {key: np.nan_to_num(values) for key, values in law.input.items()}
            if isinstance(law, Collision):
                continue  # its picture has NaN by design: tests/control/skeleton/test_collision.py
            recovers_from_nan(law, inputs, {key: values.copy() for key, values in law.applied.items()})
