"""The shipped SO-101: its URDF is the designers', and it moves on its simulated servos."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from srl.runtime.profile.profile import find, load
from srl.testing import Lab

# By angles (rad): where the gripper's frame is (m), and the torques that gravity asks (N m), by Pinocchio from the
# designers' file (so101_new_calib.urdf), to the digits here.
KNOWN = [
    ([0.0] * 6, [0.39136, -0.00001, 0.22647], [0, -0.5386, -0.4527, -0.1171, 0, 0.0035]),
    ([0.5, -0.8, 0.7, 0.3, -1.0, 0.4], [0.26848, -0.11798, 0.19808], [0, -0.219, -0.4476, -0.1149, 0.0031, 0.0019]),
]


@pytest.mark.parametrize(("angles", "place", "torques"), KNOWN)
def test_its_urdf_is_the_designers(angles: list[float], place: list[float], torques: list[float]) -> None:
    model = pin.buildModelFromUrdf(str(find("so101")[2] / "so101.urdf"))
    data, q = model.createData(), np.array(angles)
    pin.framesForwardKinematics(model, data, q)
    frame = data.oMf[model.getFrameId("gripper_frame_link")]
    assert frame.translation == pytest.approx(np.array(place), abs=1e-5)
    assert pin.computeGeneralizedGravity(model, data, q) == pytest.approx(np.array(torques), abs=1e-4)


def test_a_client_moves_it() -> None:
    robot = load("so101")[0].models["arm"].robot
    with Lab("so101") as lab:
        target = np.array([0.2, -0.2, 0.2, 0.2, -0.2, 0.3])
        lab.setpoint("client.position", robot.home)
        lab.run(0.2)
        lab.setpoint("client.position", target)
        lab.run(0.4)
        moved = lab["arm.position"].copy()
        assert (np.sign(moved) == np.sign(target)).all()
        assert lab.state == "active"
