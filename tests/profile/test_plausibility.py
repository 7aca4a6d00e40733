"""Numbers in another unit, and a calibration of nobody, cause a warning, with their place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.run import call

from srl.control.ikns import record
from srl.drivers.dynamixel import Dynamixel
from srl.runtime.cli import main
from srl.runtime.contracts.errors import ProfileError, WiringError
from srl.runtime.models import models
from srl.runtime.profile import library, profile, wiring


@pytest.mark.parametrize("name", library.shipped())
def test_shipped_profiles_raise_no_doubts(name: str) -> None:
    assert wiring.build(*profile.load(name), []).warnings == []


@pytest.mark.parametrize(
    ("change", "place", "text"),
    [
        (
            "frames.arm.rpy=[0,0,90]",
            "frames.arm.rpy.2",
            "90 rad is 14.3 turns. Are these degrees? 90 degrees are 1.571",
        ),
        ("frames.arm.position=[200,0,0.5]", "frames.arm.position.0", "200 m is more than a room. Are these millim"),
        (
            "devices.arm.load={mass: 880, centre: [0,0,0]}",
            "devices.arm.load.mass",
            "Are these grams? 880 g are 0.88 kg",
        ),
        ("sim.parts.person.off_by.rpy=[0,7,0]", "sim.parts.person.off_by.rpy.1", "7 rad is 1.11 turns"),
        ("controllers.2.calibration.tool_com=[0,0,45]", "controllers.2.calibration.tool_com.2", "45 mm are 0.045 m"),
        (
            "controllers.2.calibration.tool_com=[0,0,15]",
            "controllers.2.calibration.tool_com.2",
            "15 m is more than a limb",
        ),
        ("frames.tool.position=[0,0,10]", "frames.tool.position.2", "10 m is more than a limb"),
        ("sim.parts.arm.off_by.position=[20,0,0]", "sim.parts.arm.off_by.position.0", "more than a mount is off by"),
        ("guard.arm.torque_command.velocity=240", "guard.arm.torque_command.velocity", "240 rad/s is faster"),
        ("models.finger={kind: finger, rows: [[90,0],[0,0.04],[0,0.04],[0,0.04]]}", "models.finger.rows.0.0", "turns"),
        ("models.finger={kind: finger, rows: [[1.57,0],[0,42],[0,0.04],[0,0.04]]}", "models.finger.rows.1.1", "a limb"),
        ("devices.arm.max_age=20", "devices.arm.max_age", "what is 20 s old says nothing about now. Are these m"),
        ("frames.handle.quaternion=[1,0,1,0]", "frames.handle.quaternion", "its length is 1.41, not 1"),
    ],
)
def test_another_unit_is_doubted_at_its_place(change: str, place: str, text: str) -> None:
    (warning,) = wiring.build(*profile.load("moca-man", [change]), []).warnings
    assert place in warning
    assert text in warning


@pytest.mark.parametrize(
    "place",
    ["devices.finger.max_age", "setpoints.client.position.max_age",
     "guard.finger.position_command.following_error.timeout"],
)  # fmt: skip
def test_a_time_in_milliseconds_would_disarm_a_stop(place: str) -> None:
    window = "guard.finger.position_command.following_error.window=0.2"
    with pytest.raises(WiringError, match="Are these milliseconds"):
        wiring.build(*profile.load("servo-jog", [window, f"{place}=50"]))
    wiring.build(*profile.load("servo-jog", [window, f"{place}=5"]))
    wiring.build(*profile.load("servo-jog", [window, f"{place}=50", f"meant=[{place}]"]))


def test_a_drivers_own_age_and_a_laws_hold_are_looked_at_too(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WiringError, match=r"controllers.1.max_hold: what is 500 s old"):
        wiring.build(*profile.load("third-thumb", ["controllers.1.max_hold=500"]))
    monkeypatch.setattr(Dynamixel, "max_age", 100.0)
    with pytest.raises(WiringError, match=r"devices.finger.max_age: what is 100 s old"):
        wiring.build(*profile.load("servo-jog"))


def test_angles_of_servos_and_limits_are_doubted_too() -> None:
    set_ = ["devices.finger.servos.abduction.upper=90", "guard.finger.position_command.lower={abduction: -60}"]
    found = wiring.build(*profile.load("finger-jog", set_), []).warnings
    assert "devices.finger.servos.abduction.upper: 90 rad" in found[0]
    assert "guard.finger.position_command.lower.abduction: -60 rad" in found[1]


def test_where_a_real_device_moves_they_are_refused_unless_they_are_meant() -> None:
    upper, lower = "devices.finger.servos.abduction.upper", "guard.finger.position_command.lower"
    set_ = [f"{upper}=90", f"{lower}={{abduction: -60}}"]
    with pytest.raises(WiringError, match=r"90 degrees are 1.571 rad.*`meant: \[devices.finger.servos.abduction.upper"):
        wiring.build(*profile.load("finger-jog", set_))
    with pytest.raises(WiringError, match=f"{lower}.abduction: -60 rad"):
        wiring.build(*profile.load("finger-jog", [*set_, f"meant=[{upper}]"]))
    assert not wiring.build(*profile.load("finger-jog", [*set_, f"meant=[{upper}, {lower}]"])).warnings


@pytest.mark.parametrize(
    ("set_", "words"),
    [
        ("guard.finger.position_command.following_error={window: 20}", "following_error.window: 20 rad or m"),
        ("guard.finger.position_command.velocity=60", "60 rad/s is faster"),
    ],
)
def test_a_window_and_a_speed_in_degrees_are_refused_where_a_real_device_moves(set_: str, words: str) -> None:
    with pytest.raises(WiringError, match=words):
        wiring.build(*profile.load("finger-jog", [set_]))


def test_a_bases_speed_in_millimetres_is_doubted() -> None:
    (warning,) = wiring.build(*profile.load("base-jog", ["guard.base.twist_command.velocity=300"]), []).warnings
    assert "300 m/s is faster than any limb" in warning


@pytest.mark.parametrize("place", ["nonsense.place", "guard", "guard.finger.position_command"])
def test_what_is_meant_is_a_number_that_is_in_doubt(place: str) -> None:
    set_ = ["guard.finger.position_command.upper={abduction: 90}", f"meant=[{place}]"]
    found = wiring.build(*profile.load("finger-jog", set_), []).warnings
    assert any(f"{place}: there is no number in doubt" in text for text in found)
    assert any("90 rad" in text for text in found), "and it hides nothing"


@pytest.mark.parametrize("given", ["false", "null", "0.4", "Off", "[0.1]"])
def test_a_following_error_is_a_window_or_off(given: str) -> None:
    with pytest.raises(ProfileError, match=r"Give \{window: ..., timeout: ...\}, or off"):
        profile.load("finger-jog", [f"guard.finger.position_command.following_error={given}"])


def test_a_reaction_that_is_none_names_all_that_there_are() -> None:
    with pytest.raises(ProfileError, match=r"faults.following-error.*'hold'.*or 'stop'"):
        profile.load("finger-jog", ["faults.following-error=ignore"])


def test_a_turn_both_ways_is_a_joints_range() -> None:
    limits = "guard.arm.velocity_command.lower=[-6.2832,-6.2832,-6.2832,-6.2832,-6.2832,-6.2832]"
    assert wiring.build(*profile.load("ur-jog", [limits])).warnings == []


@pytest.mark.slow
def test_srl_check_says_so_and_a_run_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change = "frames.arm.rpy=[0,0,90]"
    assert main(["check", "moca-man", "--sim", "--set", change]) == 0
    assert "warning:" in capsys.readouterr().out
    assert main(["check", "moca-man", "--sim", "--json", "--set", change]) == 0
    assert "14.3 turns" in json.loads(capsys.readouterr().out)["warnings"][0]
    change = "frames.finger.position=[0, -20, -30]"
    run = call(tmp_path, "run", "sixth-finger", "--sim", "--fast", "--duration", "0.05", "--set", change, code=None)
    assert "warning: " in run.stderr


def test_the_simulated_wearers_calibration_is_doubted_where_a_person_is_seen() -> None:
    (warning,) = wiring.build(*profile.load("ikns-finger")).warnings
    assert "controllers.1.calibration: it was made in simulation, and 'mocap' is real" in warning
    assert wiring.build(*profile.load("ikns-finger"), ["mocap"]).warnings == []  # a real finger may follow it
    assert wiring.build(*profile.load("ikns-finger", ["input=gamepad"])).warnings == []


def test_a_persons_own_calibration_isnt_doubted(tmp_path: Path) -> None:
    made = record.read(ROOT / "profiles/ikns-finger.calibration.json")
    record.write(tmp_path / "p07.json", made.model_copy(update={"person": "P07", "simulated": False}))
    own = f"controllers.1.calibration={tmp_path / 'p07.json'}"
    assert wiring.build(*profile.load("ikns-finger", [own])).warnings == []


def test_a_calibration_by_another_body_is_doubted(tmp_path: Path) -> None:
    """Another static trial puts the zeros of the angles elsewhere, and every value of c with them."""
    bodies = models.bodies(profile.load("ikns-finger")[0].models)
    made = record.read(ROOT / "profiles/ikns-finger.calibration.json")
    record.write(tmp_path / "p07.json", made.model_copy(update={"simulated": False, "bodies": bodies}))
    own = f"controllers.1.calibration={tmp_path / 'p07.json'}"
    assert wiring.build(*profile.load("ikns-finger", [own])).warnings == []
    (warning,) = wiring.build(*profile.load("ikns-finger", [own, "models.body.stature=1.8"])).warnings
    assert "controllers.1.calibration: it was made with another body than `models:` has now" in warning


def test_a_worn_arm_that_nothing_keeps_clear_is_doubted() -> None:
    (warning,) = wiring.build(*profile.load("human-srl", ["guard.arm.position_command.clear=null"]), []).warnings
    assert "guard.arm.position_command: nothing keeps this arm clear of its wearer" in warning


def test_a_rate_at_which_an_impedance_drives_what_it_touches_is_doubted_and_the_one_that_is_told_is_enough() -> None:
    (warning,) = wiring.build(*profile.load("worn-arm", ["rate=250"])).warnings
    assert "controllers.1.stiffness: at 250 Hz its torques are too late to damp" in warning
    reported = int(warning.split("Raise 'rate' to ")[1].split(" Hz")[0])
    assert 250 < reported <= 500
    assert wiring.build(*profile.load("worn-arm", [f"rate={reported}"])).warnings == []
