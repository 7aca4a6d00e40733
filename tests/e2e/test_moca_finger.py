"""The person who leads a cobot wears a sixth finger: two systems in one profile and one world."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from srl.runtime.ipc.header import State
from srl.runtime.profile import profile
from srl.testing import simulate

pytestmark = pytest.mark.slow


@pytest.mark.exhaustive
def test_the_robot_is_led_and_the_finger_follows_the_hand() -> None:
    run = simulate(profile.find("moca-finger")[1], seconds=9.0)
    assert run.states()[-1] is State.ACTIVE
    # The plan's first part: the arm is led by (0.15, 0.1, -0.1) m.
    tool = run.value("tool.pose")[:, :3]
    started = int(np.argmax(tool.any(axis=1)))
    led = tool[4500] - tool[started]
    assert led == pytest.approx([0.15, 0.1, -0.1], abs=0.03)
    # The hand goes where the handle goes: its pose in the control point's frame stays what the tree says.
    hand = run.value("world.hand_pose")
    wrist = [_pose(hand[k]).inv() * _pose(run.value("tool.pose")[k]) for k in (1500, 4500, 8500)]
    for other in wrist[1:]:
        assert np.linalg.norm(other.translation - wrist[0].translation) < 0.02
        assert (other.rotation * wrist[0].rotation.inv()).magnitude() < 0.1
    # The finger closes with the hand that wears it, seen in the hand's own frame.
    tips, finger = run.value("world.hand_tips"), run.value("world.finger_tip")
    assert np.ptp(tips, axis=0).max() > 0.02
    assert np.ptp(finger, axis=0).max() > 0.02
    wanted = run.value("mapping.skeleton")[:, -1]
    assert np.median(np.linalg.norm(wanted - finger, axis=1)[2000:]) < 0.01
    # The hand's weight is borne by the person: with nobody pushing the robot it isn't led away.
    still = slice(200, 950)
    assert np.ptp(tool[still], axis=0).max() < 0.005


def _pose(pose: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(pose[:3], Rotation.from_quat(pose[3:], scalar_first=True))
