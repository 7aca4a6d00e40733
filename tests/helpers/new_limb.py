"""A limb that `srl new` has made, moved in simulation."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.contracts.signals import Array
from srl.runtime.models.robot_model import RobotDescription
from srl.testing import Lab


def moved_on(lab: Lab, robot: RobotDescription, seconds: float, off: float) -> Array:
    """Starts the limb at home and sends each joint 0.1 rad on, within its travel. It must follow, and stay active.

    Args:
        lab: of the profile, whose device is `arm` and whose client sends `client.position`.
        robot: the limb's.
        seconds: s, that it may take.
        off: rad, by which a joint may be off its goal then: a servo gives way under the weight.
    Returns:
        (n,) rad, where it began.
    """
    lab.setpoint("client.position", robot.home)
    lab.run(0.3)
    assert lab.state == "active"
    start: Array = lab["arm.position"].copy()
    goal = np.clip(start + 0.1, robot.q_lower + 0.01, robot.q_upper - 0.01)
    lab.setpoint("client.position", goal)
    lab.run(seconds)
    assert lab["arm.position_command.applied"] == pytest.approx(goal, abs=1e-3)
    assert lab["arm.position"] == pytest.approx(goal, abs=off)
    assert lab.state == "active"
    return start
