"""`srl new NAME --urdf FILE`: from a stranger's URDF to a simulated limb that is jogged."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.arm_urdf import ALL, HIP, TIPS
from helpers.new_limb import moved_on
from helpers.run import refused

from runtime.cli import main
from runtime.contracts.files import KeptFile
from runtime.control.robot_model import RobotModel
from runtime.jog.cut import SPEED, cut
from runtime.profile import profile
from runtime.profile.from_urdf import weight
from srl.testing import Lab


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for style, text in ALL.items():
        (tmp_path / f"{style}.urdf").write_text(text)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("style", ALL)
def test_a_strangers_urdf_becomes_a_limb_that_moves(style: str, capsys: pytest.CaptureFixture[str]) -> None:
    tip = TIPS[style]
    assert main(["new", "mine", "--urdf", f"{style}.urdf", *(["--tip", tip] if tip else [])]) == 0
    assert "srl jog mine.yaml --sim" in capsys.readouterr().out
    checked, source = profile.load("mine.yaml")
    assert cut(checked, source, "arm", SPEED, sim=True).graph.simulated == ["arm"]
    robot = checked.models["limb"].robot
    with Lab("mine.yaml") as lab:
        start = moved_on(lab, robot, seconds=2.5, off=0.1)
        assert lab["arm.position"][0] > start[0] + 0.05


def test_weight_is_the_most_in_any_posture_and_tilt() -> None:
    robot = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
    # Straight out, the shoulder carries l2, l3 and l4 at their levers.
    straight = 9.81 * (0.7 * 0.12 + 0.4 * 0.35 + 0.2 * 0.49)
    assert 0.9 * straight < weight(robot)[1] <= straight + 1e-9


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--urdf", "none.urdf"], "there is no file"),
        (["--urdf", "hip.urdf", "--tip", "hand"], "no link 'hand' for 'tip'"),
        (["--urdf", "hip.urdf", "--from", "finger-jog"], "--urdf says what the profile begins as"),
        (["--tip", "tool", "--from", "finger-jog"], "it is for a limb's URDF"),
        (["--urdf", "hip.urdf", "--port", "leg=/dev/ttyUSB1"], "leg"),
        (["--urdf", "forest.urdf"], "2 chains of joints"),
        (["--urdf", "light.urdf"], "nothing behind the joint 'pan' of light has a mass"),
    ],
)
def test_what_can_not_be_made_says_why_and_leaves_nothing(arguments: list[str], reason: str, folder: Path) -> None:
    (folder / "forest.urdf").write_text(ALL["xacro"].replace('<mimic joint="left"/>', ""))
    light = '<robot name="light"><link name="a"/><link name="b"/><joint name="pan" type="continuous">'
    (folder / "light.urdf").write_text(light + '<parent link="a"/><child link="b"/></joint></robot>')
    assert reason in refused("new", "mine", *arguments)
    assert not (folder / "mine.yaml").exists()
