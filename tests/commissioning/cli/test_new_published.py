"""`srl new NAME --urdf FILE` with published robots' files, out of the packages that bring them."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest
from helpers.new_limb import moved_on

from srl.runtime.cli import main
from srl.runtime.profile import profile
from srl.testing import Lab

DAMIAO = ("mit-can", "--set", "devices.arm.maker=damiao")
# Package, the file's end there, base, tip, driver with what it asks, number of joints.
PUBLISHED = {
    "ur3e": ("airo-models", "arms/ur3e/ur3e.urdf", "", "", DAMIAO, 6),
    "icub": ("icub-models", "robots/iCubGenova11/model.urdf", "chest", "r_hand", ("dynamixel",), 7),
    "finger": ("robot-properties-fingers", "urdf/edu/fingeredu.urdf", "", "", DAMIAO, 3),
    "so101": ("example-robot-data", "so_arm_description/urdf/so101.urdf", "", "gripper_frame_link", ("feetech",), 5),
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
    assert main(["new", "mine", "--urdf", str(file), *ends, "--driver", *driver]) == 0
    assert "too little room" not in capsys.readouterr().out
    robot = profile.load("mine.yaml")[0].models["limb"].robot
    assert len(robot.labels) == joints
    with Lab("mine.yaml") as lab:
        moved_on(lab, robot, seconds=2.0, off=0.12)
