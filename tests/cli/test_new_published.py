"""`srl new NAME --urdf FILE` with published robots' files, out of the packages that bring them."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from runtime.cli import main
from runtime.profile import profile
from srl.testing import Lab

# Package, the file's end there, base, tip, driver, number of joints.
PUBLISHED = {
    "icub": ("icub-models", "robots/iCubGenova11/model.urdf", "chest", "r_hand", "dynamixel", 7),
    "so101": ("example-robot-data", "so_arm_description/urdf/so101.urdf", "", "gripper_frame_link", "feetech", 5),
    "finger": ("example-robot-data", "finger_edu_description/robots/finger_edu.urdf", "", "", "feetech", 3),
}


def file_of(package: str, end: str) -> Path:
    try:
        files = metadata.distribution(package).files or []
    except metadata.PackageNotFoundError:
        pytest.skip(f"{package} isn't installed, which brings this robot's URDF")
    return Path(next(file.locate() for file in files if str(file).endswith(end))).resolve()


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_robot_becomes_a_limb_that_moves(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    package, end, base, tip, driver, joints = PUBLISHED[name]
    file = file_of(package, end)
    monkeypatch.chdir(tmp_path)
    ends = [word for key, link in (("--base", base), ("--tip", tip)) if link for word in (key, link)]
    assert main(["new", "mine", "--urdf", str(file), *ends, "--driver", driver]) == 0
    assert "too little room" not in capsys.readouterr().out
    robot = profile.load("mine.yaml")[0].models["limb"].robot
    assert len(robot.labels) == joints
    with Lab("mine.yaml") as lab:
        lab.setpoint("client.position", robot.home)
        lab.run(0.3)
        assert lab.state == "active"
        start = lab["arm.position"].copy()
        goal = np.clip(start + 0.1, robot.q_lower + 0.01, robot.q_upper - 0.01)
        lab.setpoint("client.position", goal)
        lab.run(2.0)
        assert lab["arm.position_command.applied"] == pytest.approx(goal, abs=1e-3)
        assert lab["arm.position"] == pytest.approx(goal, abs=0.12)  # a servo gives way under the weight
        assert lab.state == "active"
