"""`srl new NAME --urdf FILE`: from a stranger's URDF to a simulated limb that is jogged."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from helpers.arm_urdf import ALL, HIP, TIPS
from helpers.new_limb import moved_on
from helpers.run import refused

from srl.commissioning.cli import new_questions
from srl.commissioning.jog.profile_subset import SPEED, subset
from srl.commissioning.new.from_urdf import hanging, weight
from srl.commissioning.new.limb_drivers import limb_drivers
from srl.drivers.mit_can.limb import MitCanLimb
from srl.runtime.cli import main
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.limb_drives import LimbJoint
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.runtime.profile import profile
from srl.testing import Lab

SERVOS = ["--driver", "dynamixel"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for style, text in ALL.items():
        (tmp_path / f"{style}.urdf").write_text(text)
    return tmp_path


REPORT_EVERY = {
    "dynamixel": [],
    "damiao": ["maker=damiao"],
    "ak-v2": ["maker=cubemars", "firmware=v2", "enable_at_open=true"],
    "ak-v3": ["maker=cubemars", "firmware=v3", "enable_at_open=true"],
    "cubemars-servo": ["timeout=1.0"],
    "odrive": ["firmware=0.5", "watchdog_set=true"],
}


def arguments(style: str, actuators: str) -> list[str]:
    tip = TIPS[style]
    driver = actuators if actuators in limb_drivers() else "mit-can"
    output = [word for each in REPORT_EVERY[actuators] for word in ("--set", f"devices.arm.{each}")]
    return ["new", "mine", "--urdf", f"{style}.urdf", *(["--tip", tip] if tip else []), "--driver", driver, *output]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("style", "actuators"),
    [
        ("exported", "dynamixel"),
        ("xacro", "dynamixel"),
        ("exported", "damiao"),
        *(("hip", each) for each in REPORT_EVERY),
    ],
)
def test_a_strangers_urdf_becomes_a_limb_that_moves(
    style: str, actuators: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(style, actuators)) == 0
    assert "srl jog mine.yaml --sim" in capsys.readouterr().out
    checked, source = profile.load("mine.yaml")
    assert subset(checked, source, "arm", SPEED, sim=[]).graph.simulated == ["arm"]
    robot = checked.models["limb"].robot
    with Lab("mine.yaml") as lab:
        start = moved_on(lab, robot, seconds=2.5, off=0.1)
        assert lab["arm.position"][0] > start[0] + 0.05


@pytest.mark.parametrize("driver", limb_drivers())
def test_what_only_a_person_knows_is_asked_for(
    driver: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoints = {"axis0.config.watchdog_timeout": {"id": 1, "type": "float"},
                 "axis0.config.enable_watchdog": {"id": 2, "type": "bool"},
                 "axis0.config.motor.torque_constant": {"id": 3, "type": "float"}}  # fmt: skip
    file = folder / "flat_endpoints.json"
    file.write_text(json.dumps({"fw_version": "0.6.10", "hw_version": "4.4.58", "endpoints": endpoints}))
    typed = {
        "mit-can": ["BMW", "cubemars", "v4", "v1", "no", "yes"],
        "cubemars-servo": ["a while", "-1", "0.5"],
        "odrive": ["0.7", "0.6", "none.json", "flat_endpoints.json"],
    }.get(driver, [])
    answers = iter(["pneumatic", driver, *typed])
    monkeypatch.setattr(new_questions, "_terminal", lambda: True)
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    (folder / "there").mkdir()
    assert main(["new", "mine", "--urdf", "hip.urdf", "--tip", "tool", "--out", "there/mine.yaml"]) == 0
    assert next(answers, None) is None, "all was asked"
    device = profile.load("there/mine.yaml")[0].devices["arm"]
    assert device.driver == driver
    wanted = {"mit-can": {"firmware": "v1", "enable_at_open": True}, "cubemars-servo": {"timeout": 0.5},
              "odrive": {"firmware": "0.6", "endpoints": "../flat_endpoints.json"}}.get(driver, {})  # fmt: skip
    assert wanted.items() <= {key: device.options[key] for key in wanted}.items()
    assert "'pneumatic' is none of them" in capsys.readouterr().out


def test_another_packages_driver_moves_a_limb(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    info = tmp_path / "muscle-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: muscle\nVersion: 1\n")
    (info / "entry_points.txt").write_text(
        "[srl.limbs]\nmuscle = muscle:Muscle\nmissile = muscle:Missile\nmussel = muscle:Muscle\n"
        "[srl.drivers]\nmuscle = srl.drivers.feetech.driver:Feetech\n"
        "[srl.fakes]\nmuscle = srl.sim.devices.feetech.fake:FakeFeetech\n"
    )
    (tmp_path / "muscle.py").write_text(
        "from srl import LimbDrives\n"
        "class Muscle(LimbDrives):\n"
        "    driver, words, part, port = 'muscle', 'artificial muscles', 'feetech-chain', '/dev/muscle'\n"
        "class Missile: pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "muscle", raising=False)
    assert main(["new", "mine", "--urdf", "hip.urdf", "--tip", "tool", "--driver", "muscle"]) == 0
    assert profile.load("mine.yaml")[0].devices["arm"].options["port"] == "/dev/muscle"
    assert main(["new", "other", "--urdf", "hip.urdf", "--tip", "tool", "--driver", "missile"]) == 2
    assert "is no LimbDrives" in capsys.readouterr().err
    assert main(["new", "other", "--urdf", "hip.urdf", "--tip", "tool", "--driver", "mussel"]) == 2
    assert "gives the driver 'muscle'" in capsys.readouterr().err


def test_a_motor_is_as_stiff_as_the_weight_needs_and_as_can_be_damped() -> None:
    mit = MitCanLimb()
    (motor,) = (m for m in mit.motors({"maker": "damiao"}) if m.name == "DM8009")
    light = LimbJoint("j", False, -1.0, 1.0, 0.0, 0.5, torque=2.0, inertia=0.05)
    kp, kd = mit.gains(light, motor)
    assert kp == pytest.approx(2.0 / 0.05)
    moved = 0.05 + motor.inertia  # type: ignore[attr-defined]
    assert kd / 2 / np.sqrt(kp * moved) == pytest.approx(0.7)
    heavy = replace(light, torque=20.0, inertia=4.0)
    kp, kd = mit.gains(heavy, motor)
    assert kd == 5.0
    assert kd / 2 / np.sqrt(kp * 4.0) == pytest.approx(0.3, abs=0.01)
    assert "pull it by" in mit.strained(heavy, motor)
    assert not mit.strained(light, motor)


@pytest.mark.parametrize(
    ("lower", "upper", "slides"),
    [(-np.inf, np.inf, False), (-6.3, 6.3, False), (-6.3, 0.05, False), (4.0, 11.0, False), (0.0, 0.9, True)],
)
def test_a_travel_is_narrowed_to_what_an_encoder_at_the_shaft_tells(lower: float, upper: float, slides: bool) -> None:
    """The joint's home stays inside, and no two turns of the shaft fit in."""
    mit = MitCanLimb()
    home = 0.0 if lower <= 0.0 <= upper else (lower + upper) / 2
    joint = LimbJoint("j", slides, lower, upper, home, 0.5, torque=1.0, inertia=0.1)
    bounds = mit.bounds(joint)
    assert lower <= bounds["lower"] <= home <= bounds["upper"] <= upper
    assert (bounds["upper"] - bounds["lower"]) / mit.lead(joint) + 0.2 < 2 * np.pi


def test_weight_is_the_most_in_any_posture_and_tilt() -> None:
    robot = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
    # Straight out, the shoulder carries l2, l3 and l4 at their levers.
    straight = 9.81 * (0.7 * 0.12 + 0.4 * 0.35 + 0.2 * 0.49)
    assert 0.9 * straight < weight(robot)[1] <= straight + 1e-9


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--urdf", "none.urdf", *SERVOS], "there is no file"),
        (["--urdf", "hip.urdf", "--tip", "hand", *SERVOS], "no link 'hand' for 'tip'"),
        (["--urdf", "hip.urdf", "--from", "finger-jog"], "--urdf says what the profile begins as"),
        (["--tip", "tool", "--from", "finger-jog"], "it is for a limb's URDF"),
        ([*SERVOS, "--from", "finger-jog"], "it is for a limb's URDF"),
        (["--urdf", "hip.urdf", "--port", "leg=/dev/ttyUSB1", *SERVOS], "leg"),
        (["--urdf", "forest.urdf", *SERVOS], "2 chains of joints"),
        (["--urdf", "light.urdf", *SERVOS], "nothing behind the joint 'pan' of light has a mass"),
        (["--urdf", "hip.urdf"], "it isn't said what moves the limb's joints. For example"),
        (["--urdf", "hip.urdf", "--driver", "mit-can"], "Add --set devices.arm.maker=damiao (damiao or cubemars)"),
        (["--urdf", "hip.urdf", "--driver", "odrive", "--set", "devices.arm.firmware=0.5",
          "--set", "devices.arm.watchdog_set=no"], "Set axisN.config.watchdog_timeout = 0.5"),
        (["--urdf", "exported.urdf", "--driver", "odrive", "--set", "devices.arm.firmware=0.5",
          "--set", "devices.arm.watchdog_set=yes"], "'Joint_3' slides, and it moves joints that turn"),
    ],
)  # fmt: skip
def test_what_can_not_be_made_says_why_and_leaves_nothing(arguments: list[str], reason: str, folder: Path) -> None:
    (folder / "forest.urdf").write_text(ALL["xacro"].replace('<mimic joint="left"/>', ""))
    light = '<robot name="light"><link name="a"/><link name="b"/><joint name="pan" type="continuous">'
    (folder / "light.urdf").write_text(light + '<parent link="a"/><child link="b"/></joint></robot>')
    assert reason in refused("new", "mine", *arguments)
    assert not (folder / "mine.yaml").exists()


def test_a_limb_of_loose_drives_begins_where_it_hangs() -> None:
    """On its twin it hangs loose before a run opens, and must be found where it is said to be parked."""
    robot = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
    q = hanging(robot)
    assert q[1] == pytest.approx(np.pi / 2, abs=0.01), "straight down"
    torque = pin.computeGeneralizedGravity(model := pinocchio_model(robot), model.createData(), q)
    assert torque == pytest.approx(np.zeros(4), abs=0.01)
