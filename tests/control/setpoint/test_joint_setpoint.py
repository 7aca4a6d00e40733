"""Jogging joints from the bus."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound

from srl.control.setpoint.joint_setpoint import JointSetpoint, JointSetpointConfig
from srl.runtime.contracts.errors import ProfileError


def jog() -> JointSetpoint:
    controller = bound(JointSetpoint("jog", JointSetpointConfig(joints=("a", "b"))))
    controller.input["target"][:] = np.nan
    controller.applied["q"][:] = [0.3, -0.2]
    controller.reset()
    return controller


def test_holds_the_applied_until_a_whole_target_comes() -> None:
    controller = jog()
    for target in ([np.nan, np.nan], [np.nan, 1.0], [np.inf, 1.0]):
        controller.input["target"][:] = target
        controller.update(0.01)
        np.testing.assert_array_equal(controller.output["q"], [0.3, -0.2])
    controller.input["target"][:] = [0.5, 0.6]
    controller.update(0.01)
    np.testing.assert_array_equal(controller.output["q"], [0.5, 0.6])
    np.testing.assert_array_equal(controller.output["q_velocity"], 0.0)


def test_a_reset_forgets_the_old_target() -> None:
    controller = jog()
    controller.input["target"][:] = [0.5, 0.6]
    controller.update(0.01)
    controller.applied["q"][:] = [0.4, 0.1]
    controller.reset()
    controller.update(0.01)
    np.testing.assert_array_equal(controller.output["q"], [0.4, 0.1])
    controller.input["target"][:] = [0.5, 0.7]
    controller.update(0.01)
    np.testing.assert_array_equal(controller.output["q"], [0.5, 0.7])


def test_doubled_labels_are_refused() -> None:
    with pytest.raises(ProfileError, match="more than once"):
        JointSetpoint("jog", JointSetpointConfig(joints=("a", "a")))
