"""A hand that does what a calibration says."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.contracts.wearer import Explore, Rest, Shape
from srl.runtime.models.human_hand import JOINTS, RANGES
from srl.sim.wearer.instructed import SECONDS, InstructedWearer

FIST = Shape({"index_mpj": 1.2, "ring_middle_abduction": 0.2})


def reported(miss: float = 0.0) -> InstructedWearer:
    made = InstructedWearer(3, miss=miss)
    assert made.done
    made.target(1.0)
    made.instruct(FIST)
    return made


def test_it_goes_to_the_shape_by_sensors_names_and_holds_it() -> None:
    made = reported()
    np.testing.assert_array_equal(made.target(1.0), np.zeros(20))
    assert not made.done
    there = made.target(1.0 + SECONDS)
    assert made.done
    assert there[JOINTS.index("index_mcp_flexion")] == pytest.approx(1.2)
    assert there[JOINTS.index("ring_mcp_abduction")] == pytest.approx(-0.2)
    made.instruct(Rest())
    np.testing.assert_array_equal(made.target(9.0), there)


def test_it_misses_a_little_and_stays_within_its_ranges() -> None:
    there = reported(0.4).target(5.0)
    assert np.abs(there - reported().target(5.0)).max() > 0.1
    assert ((RANGES[:, 0] <= there) & (there <= RANGES[:, 1])).all()
    np.testing.assert_array_equal(there, reported(0.4).target(5.0))


def test_it_goes_on_as_it_was_saved() -> None:
    made, other = reported(0.1), InstructedWearer(3, miss=0.1)
    made.target(1.3)
    other.restore(made.save())
    made.instruct(Shape({}))
    other.instruct(Shape({}))
    np.testing.assert_array_equal(made.target(1.6), other.target(1.6))


def test_a_hand_alone_doesnt_explore() -> None:
    with pytest.raises(ValueError, match="a hand alone isn't told to Explore"):
        reported().instruct(Explore())
