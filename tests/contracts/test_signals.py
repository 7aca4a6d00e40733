"""The names of a signal's elements: what is refused, and that every shipped part has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers.names import Device, Law, command, joints
from helpers.null_space_arm import calibrated

from srl.drivers.cyberglove.protocol import LABELS
from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import WRENCH
from srl.runtime.models.human_hand import SENSORS
from srl.runtime.models.models import FingerModel
from srl.runtime.models.robots import ARMS
from srl.runtime.profile import library, profile, wiring
from srl.testing import check_controller, check_driver

FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({"shape": (2,)}, "neither `labels` nor `slots`"),
    "both": ({"shape": (2,), "labels": ("a", "b"), "slots": True}, "slots"),
    "too few": ({"shape": (3,), "labels": ("a", "b")}, "2 labels for 3 rows"),
    "twice": ({"shape": (2,), "labels": ("a", "a")}, "'a' is the name of two"),
    "no components": ({"shape": (1, 3)}, "further axes of \\[3\\]"),
    "too few components": ({"shape": (1, 3), "components": (("x", "y"),)}, "components of \\[2\\]"),
    "a comma": ({"shape": (1,), "labels": ("a,b",)}, "commas"),
}
NAMED: list[dict[str, Any]] = [
    {"shape": ()},
    {"shape": (1,)},
    {"shape": (2,), "labels": ("a", "b")},
    {"shape": (4, 3), "slots": True, "components": (("x", "y", "z"),)},
]


@pytest.mark.parametrize("what", FAULTS)
def test_what_has_no_names_is_told(what: str) -> None:
    given, reported = FAULTS[what]
    with pytest.raises(AssertionError, match=reported):
        assert not (fault := Signal(name="s", unit="1", **given).naming_fault()), fault


@pytest.mark.parametrize("given", NAMED)
def test_what_has_names_is_taken(given: dict[str, Any]) -> None:
    assert Signal(name="s", unit="1", **given).naming_fault() == ""


LIMITS = {"lower": -1.0, "upper": 1.0, "velocity": 1.0, "acceleration": 1.0}


def law_of(name: str, folder: Path) -> Controller:
    """The law as a shipped profile has it, or with the least options."""
    for shipped in library.shipped():
        if f"use: {name}\n" in profile.find(shipped)[1]:
            laws = [law.controller for law in wiring.build(*profile.load(shipped), []).laws]
            if found := [law for law in laws if isinstance(law, registry.load("controllers", name, "test"))]:
                return found[0]
    seen = {"rotation": {"Hips": "suit.rotation[Hips]"}, "translation": {"Hips": "suit.translation[Hips]"}}
    options: dict[str, dict[str, Any]] = {
        "ikns": {"calibration": str(folder / "p07.json")},
        "contact-cue": {"labels": ["x"], "motors": ["m"], "threshold": 1.0, "full": 2.0},
        "state-cue": {"motors": ["m"]},
        "jog": {"speed": {"a": 0.1}, "acceleration": {"a": 1.0}},
        "joint-setpoint": {"joints": ["a"]},
        "velocity-setpoint": {"axes": ["a"]},
        "pose-in-frame": {"frame": "a"},
        "cartesian-follow": {"robot": "panda"},
        "arm-reach": {"robot": "panda"},
        "joint-impedance": {"robot": "panda", "stiffness": 10.0},
        "mirror": {"robot": "panda", "other": "panda", "normal": [0.0, 1.0, 0.0]},
        "waypoints": {
            "robot": "ur16e", "waypoints": {"rest": dict.fromkeys(ARMS["ur16e"].labels, 0.0)},
            "speed": 0.1, "acceleration": 1.0, "jerk": 10.0,
        },
        "reach": {k: {f"J{i}": v for i in range(1, 8)} for k, v in LIMITS.items()},
        "suit-joints": {"segments": {"pelvis": "Hips"}},
        "suit-segments": {"joints": {"chest": "Spine3"}, "frame": "room"},
        "finger-closure": {"open": 0.0, "closed": 1.0, "model": FingerModel()},
        "calibration-marks": {
            "person": "P1",
            "dofs": ["swivel"],
            "angles": {"elbow": "arm.angles[elbow]"},
            "hand": "arm.hand",
        },
        "emg-marks": {"person": "P1", "signal": "emg.samples", "count": "emg.count", "muscles": ["biceps"]},
        "suit-marks": {"person": "P1", "signal": "suit.rotation", "segments": ["Hips"], "parents": [-1]},
        "ft-marks": {"signal": "sensor.wrench", "wrench": {name: f"sensor.wrench[{name}]" for name in WRENCH}},
        "frame-marks": {"frame": "arm", "parent": "room", "drivers": {"a": "vicon"}, "parent_signal": "a.b.pose"},
        "glove-marks": {"person": "P1", "signal": "glove.raw", "hand": "right", "sensors": ["thumb_roll"]},
        "servo-marks": {
            "device": "finger", "driver": "firmata", "signal": "finger.position_command.sent", "joints": {"a": {}},
            "mirror": [0.0], "home": None, "lower": [-1.0], "upper": [1.0], "measures": False,
        },
        "intention-marks": {"person": "P1", "actions": ["wave", "point"], "trunk": ["Spine"], **seen},
        "task-marks": {
            "person": "P1", "teach": True, **seen,
            **{k: {f"J{i}": v for i in range(1, 8)} for k, v in LIMITS.items()},
        },
    }  # fmt: skip
    if name == "ikns":
        calibrated(folder / "p07.json")
    cls = registry.load("controllers", name, "test")
    law: Controller = cls("law", cls.Config.model_validate(options.get(name, {})))
    return law


@pytest.mark.parametrize("name", registry.names("controllers"))
def test_every_law_names_its_elements(name: str, tmp_path: Path) -> None:
    law = law_of(name, tmp_path)
    for signal in (*law.inputs, *law.outputs):
        assert not signal.naming_fault(), signal.name


@pytest.mark.parametrize("name", library.shipped())
def test_every_simulated_truth_names_its_elements(name: str) -> None:
    graph = wiring.build(*profile.load(name), [])
    assert graph.world is not None
    for signal in graph.world.truth:
        assert not signal.naming_fault(), signal.name


@pytest.mark.parametrize("sensors", [18, 22])
def test_the_law_of_the_glove_knows_its_sensors_by_their_names(sensors: int) -> None:
    assert SENSORS[sensors] == LABELS[sensors]


def test_a_package_learns_from_its_own_tests_that_names_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    bare = Signal(name="x", shape=(2,), unit="rad")
    monkeypatch.setattr(Device, "declared", {"bare": ((bare,), ())})
    monkeypatch.setattr(Device, "summary", "somebody else's")
    with pytest.raises(AssertionError, match=r"Device.x: it has 2 rows and declares neither"):
        check_driver(Device("bare", DeviceConfig()))
    other = command("goal", "a", "b", feedback="x")
    monkeypatch.setattr(Device, "declared", {"other": ((joints("x", "a", "c"),), (other,))})
    with pytest.raises(AssertionError, match=r"Device.goal and its feedback differ in the names"):
        check_driver(Device("other", DeviceConfig()))
    monkeypatch.setattr(Law, "declared", {"law": ((bare,), ())})
    with pytest.raises(AssertionError, match=r"Law.x: it has 2 rows"):
        check_controller(Law("law", ControllerConfig()), {}, {})
