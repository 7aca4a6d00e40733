"""Jogging velocities from the bus."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound

from srl.control.setpoint.velocity_setpoint import VelocitySetpoint, VelocitySetpointConfig
from srl.runtime.contracts.errors import ProfileError


def test_zero_until_a_new_finite_target_comes_and_zero_without_one() -> None:
    controller = bound(VelocitySetpoint("jog", VelocitySetpointConfig(axes=("a", "b"))))
    target, velocity = controller.input["target"], controller.output["velocity"]
    target[:] = [0.5, 0.1]  # an old one, still there at the reset
    controller.reset()
    controller.update(0.01)
    np.testing.assert_array_equal(velocity, 0.0)
    target[:] = [0.5, -0.1]
    controller.update(0.01)
    np.testing.assert_array_equal(velocity, [0.5, -0.1])
    for nothing in ([np.nan, 0.0], [np.inf, 0.0]):
        target[:] = nothing
        controller.update(0.01)
        np.testing.assert_array_equal(velocity, 0.0)
    controller.reset()
    np.testing.assert_array_equal(velocity, 0.0)


def test_doubled_labels_are_refused() -> None:
    with pytest.raises(ProfileError, match="more than once"):
        VelocitySetpoint("jog", VelocitySetpointConfig(axes=("a", "a")))
