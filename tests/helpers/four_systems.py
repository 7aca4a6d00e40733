"""One simulated wearer, measured at the same time by four capture systems, each into the same laws."""

from __future__ import annotations

from math import sqrt
from typing import Any

from ruamel.yaml import YAML

from helpers import ROOT
from srl.runtime.contracts.rotation import Pose, composed, product

SYSTEMS = ("vicon", "optitrack", "xsens", "noitom")
C = sqrt(0.5)
_SUIT = (0.5, -0.5, -0.5, -0.5)  # x forward, y left, z up in the suit's axes
_ARM: dict[str, tuple[str, str]] = {  # of the body model: the suit's joint, and the segment of it
    "thorax": ("Spine3", "torso"), "upper": ("RightArm", "right_upper_arm"),
    "fore": ("RightForeArm", "right_forearm"), "palm": ("RightHand", "right_hand"),
}  # fmt: skip
_MVN = {"thorax": "t8", "upper": "right_upper_arm", "fore": "right_fore_arm", "palm": "right_hand"}
_SAME = (1.0, 0.0, 0.0, 0.0)
_AXES = {"vicon": _SAME, "noitom": _SAME, "xsens": (0.5, 0.5, 0.5, 0.5), "optitrack": (C, C, 0.0, 0.0)}


def places(system: str) -> dict[str, dict[str, Any]]:
    """`segments` of `arm-angles`: the body model's segment in each measured one. The chest's notch is a made-up one."""
    axes: Pose = (0.0, 0.0, 0.0, *_AXES[system])
    made = {}
    for name, (_, segment) in _ARM.items():
        chest = name == "thorax"
        own: Pose = (0.066, 0.051, 0.084, *_SUIT) if chest else (0.0, 0.0, 0.0, *product(_SUIT, (C, -C, 0.0, 0.0)))
        x, y, z, *q = composed(axes, own)
        made[name] = {"segment": segment, "position": [x, y, z], "quaternion": q}
    return made


def profile(script: str = "reach", exact: bool = False) -> dict[str, Any]:
    """The keys of a profile: the wearer, the four systems, and for each `NAME_arm` and `NAME_suit`."""
    parts = {"wearer": {"part": "body", "script": script, "at": "world"}}
    bodies = {name: f"wearer/{joint}" for name, (joint, _) in _ARM.items()}
    chosen = {system: _shipped(system) for system in SYSTEMS if system != "noitom"}
    devices: dict[str, Any] = {"noitom": {"driver": "noitom", "port": "tcp://h:7001"}}
    fakes: dict[str, Any] = {"noitom": {"rate": 60, "delay": 0.03}}
    for system, (device, fake, _) in chosen.items():
        # What IKNS takes is a subject of its own where cameras measure; MVN has these segments anyhow.
        if system == "xsens":
            devices[system], fakes[system] = device, fake
            continue
        wanted = device["segments"] | {name: f"Arm/{name}" for name in _ARM}
        devices[system] = device | {"segments": wanted}
        fakes[system] = fake | {"bodies": fake["bodies"] | {"Arm": bodies}}
    if exact:
        fakes = {system: fake | {"noise": 0.0, "delay": 0.0, "rate": 100.0} for system, fake in fakes.items()}
    controllers: list[dict[str, Any]] = []
    for system, (_, _, law) in chosen.items():
        controllers.append(law | {"name": f"{system}_suit", "in": {k: f"{system}.{k}" for k in ("pose", "visible")}})
    joints = {name: joint for name, (joint, _) in _ARM.items()}
    controllers.append(
        {"use": "suit-segments", "name": "noitom_segments", "joints": joints, "frame": "world"}
        | {"in": {k: f"noitom.{k}" for k in ("rotation", "translation")}}
    )
    for system in SYSTEMS:
        owner = "noitom_segments" if system == "noitom" else system
        wires: dict[str, Any] = {k: f"{owner}.{k}" for k in ("pose", "visible")}
        if system == "xsens":
            wires = {k: {"from": wire, "map": _MVN} for k, wire in wires.items()}
        controllers.append({"use": "arm-angles", "name": f"{system}_arm", "segments": places(system), "in": wires})
    return {
        "name": "four-systems",
        "rate": 100,
        "devices": devices,
        "controllers": controllers,
        "faults": {"intent-loss": "hold"},
        "models": {"body": {"kind": "body", "sides": ["right"], "lengths": {"upper_arm": 0.265, "forearm": 0.26}}},
        "frames": {"world": {}, "suit": {"parent": "world", "quaternion": [0.5, 0.5, 0.5, 0.5]}},
        "sim": {"world": "cell", "start": "auto", "parts": parts, "devices": fakes},
    }


def _shipped(system: str) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Of the shipped profile's choice: the device, its fake's options, and the law that makes a suit of it."""
    text = (ROOT / "profiles" / "human-srl.yaml").read_text()
    branch: dict[str, Any] = YAML(typ="safe").load(text)["choices"]["capture"][system]
    (device,), (law,) = branch["devices"].values(), branch["controllers"]
    (fake,) = branch["sim"]["devices"].values() if "sim" in branch else ({"rate": 60, "delay": 0.03},)
    return device, fake, law
