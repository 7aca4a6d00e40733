"""Whether the arm can follow a path is found before it is tried."""

import numpy as np
import pytest
from helpers.operation import LOWER, START, UPPER, envelope, posture, ranges
from helpers.skeleton import human_srl
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.operation.demonstration import TaskError, TaskPath
from srl.control.operation.reach import Reach
from srl.control.operation.worn import Worn


def arm() -> Worn:
    made = Worn(human_srl(), "right", envelope())
    made.see(*posture(), 0.0)
    return made


@given(st.integers(0, 300))
@settings(max_examples=15)
def test_what_the_arm_has_done_is_within_reach(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = LOWER + rng.uniform(0.1, 0.9, (2, 7)) * (UPPER - LOWER)
    worn = arm()
    points = np.array([worn.tip(a + s * (b - a))[0].copy() for s in np.linspace(0.0, 1.0, 40)])
    assert Reach(TaskPath(points), worn, ranges(), a).step(100_000)


def test_place_out_of_reach_is_named() -> None:
    worn = arm()
    here = worn.tip(START)[0].copy()
    reach = Reach(TaskPath(np.linspace(here, here + np.array([0.0, 0.0, 0.8]), 30)), worn, ranges(), START)
    with pytest.raises(TaskError, match=r"doesn't reach the place \d\.\d s after"):
        reach.step(100_000)
    assert not reach.done
