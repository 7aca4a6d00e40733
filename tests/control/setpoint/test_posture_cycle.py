"""The law that goes from posture to posture."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound
from pydantic import ValidationError

from srl.control.setpoint.posture_cycle import PostureCycle, PostureCycleConfig

A, B = {"a": 0.0, "b": 0.0}, {"a": -0.5, "b": 0.1}


def law(**options: object) -> PostureCycle:
    config = {"postures": (A, B), "near": {"a": 0.05, "b": 0.005}, "rest": 0.03} | options
    controller = bound(PostureCycle("motion", PostureCycleConfig.model_validate(config)))
    controller.applied["q"][:] = controller.input["position"][:] = [0.2, 0.02]
    controller.reset()
    return controller


def go(controller: PostureCycle, cycles: int, at: tuple[float, float]) -> list[float]:
    controller.input["position"][:] = at
    for _ in range(cycles):
        controller.update(0.01)
    return list(controller.output["q"])


def test_it_rests_first_and_goes_on_only_when_every_joint_has_arrived() -> None:
    controller = law()
    assert go(controller, 3, (0.2, 0.02)) == [0.2, 0.02]
    assert go(controller, 1, (0.2, 0.02)) == [0.0, 0.0]
    assert go(controller, 50, (0.0, 0.006)) == [0.0, 0.0]  # b isn't there yet
    go(controller, 1, (0.049, -0.004))
    assert controller.metrics() == {"arrivals": 1}
    assert go(controller, 3, (0.0, 0.0)) == [-0.5, 0.1]
    go(controller, 10, (-0.5, 0.1))
    assert go(controller, 1, (-0.5, 0.1)) == [0.0, 0.0]  # round and round


def test_a_position_that_is_no_number_is_no_arrival() -> None:
    controller = law()
    assert go(controller, 50, (0.0, np.nan)) == [0.0, 0.0]
    assert controller.metrics() == {"arrivals": 0}


def test_after_a_reset_it_begins_where_the_limb_is_and_goes_where_it_went() -> None:
    controller = law()
    go(controller, 8, (0.0, 0.0))
    assert list(controller.output["q"]) == [-0.5, 0.1]
    controller.applied["q"][:] = [-0.2, 0.05]
    controller.reset()
    assert go(controller, 3, (-0.2, 0.05)) == [-0.2, 0.05]
    assert go(controller, 1, (-0.2, 0.05)) == [-0.5, 0.1]


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"postures": (A,)}, "at least 2"),
        ({"postures": (A, {"a": 0.0})}, "postures.1: 'b' is missing"),
        ({"postures": (A, {"a": 0.0, "c": 0.0})}, "no element is called 'c'"),
        ({"near": {"a": 0.1, "b": 0.0}}, "near must be more than 0"),
        ({"near": {"a": 0.1}}, "'b' is missing"),
    ],
)
def test_what_cant_be_meant_is_refused(options: dict[str, object], fault: str) -> None:
    with pytest.raises(ValidationError, match=fault):
        law(**options)
