"""Where MVN's 23 segments are on a simulated person: on which body of the cell, and how they lie in it.

A segment's axes are those of MVN's world in the T-pose: x forward, y left, z up.
"""

from __future__ import annotations

from math import sqrt
from typing import Final

from srl.drivers.xsens_mvn.protocol import SEGMENTS
from srl.runtime.contracts.rotation import Pose
from srl.sim.parts.body.body import BodyPart
from srl.sim.parts.body.upper_body import UpperBodyPart

_SUIT: Final = (0.5, -0.5, -0.5, -0.5)  # x forward, y left, z up in the suit's x left, y up, z forward
_TOE: Final = (0.0, -0.06, 0.14)  # m, from the ankle in the suit's axes; ours
_TRUNK: Final = {"axis-neuron": ("Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Head")}
_TRUNK["axis-studio"] = ("Hips", "Spine", "Spine1", "Spine1", "Spine2", "Neck", "Head")
_ARM: Final = {"Shoulder": "Shoulder", "UpperArm": "Arm", "ForeArm": "ForeArm", "Hand": "Hand"}
_LEG: Final = {"UpperLeg": "UpLeg", "LowerLeg": "Leg", "Foot": "Foot", "Toe": "Foot"}
# Of a person whose trunk is one piece: m, in the chest's frame; ours.
_STIFF: Final = {
    "Pelvis": -0.50, "L5": -0.42, "L3": -0.32, "T12": -0.22, "T8": -0.12, "Neck": 0.05, "Head": 0.14,
}  # fmt: skip
_LEGS: Final = {"UpperLeg": -0.52, "LowerLeg": -0.94, "Foot": -1.36, "Toe": -1.40}
_BACK: Final = -0.08  # m, of the spine behind the jugular notch
_HALF: Final = sqrt(0.5)


def places(person: BodyPart | UpperBodyPart) -> list[tuple[str, Pose]]:
    """Of each segment in MVN's order: the body of the cell, and the segment's pose in it."""
    made = _whole(person) if isinstance(person, BodyPart) else _upper(person)
    return [made[name] for name in SEGMENTS]


def _whole(person: BodyPart) -> dict[str, tuple[str, Pose]]:
    joints = dict(zip(SEGMENTS[:7], _TRUNK[person.skeleton.kind], strict=True))
    for side in ("Right", "Left"):
        joints |= {side + own: side + joint for own, joint in (_ARM | _LEG).items()}
    return {
        name: (f"{person.name}/{joint}", (*(_TOE if name.endswith("Toe") else (0.0, 0.0, 0.0)), *_SUIT))
        for name, joint in joints.items()
    }


def _upper(person: UpperBodyPart) -> dict[str, tuple[str, Pose]]:
    torso = f"{person.name}/torso"
    made: dict[str, tuple[str, Pose]] = {
        name: (torso, (_BACK, 0.0, z, 1.0, 0.0, 0.0, 0.0)) for name, z in _STIFF.items()
    }
    for side, sign in (("Right", -1.0), ("Left", 1.0)):
        for name, z in _LEGS.items():
            ahead = 0.12 if name == "Toe" else 0.0
            made[side + name] = (torso, (_BACK + ahead, sign * 0.09, z, 1.0, 0.0, 0.0, 0.0))
        if side.lower() not in person.body.sides:  # that arm is no part of the person: it stays at rest
            made |= {side + name: (torso, (_BACK, sign * 0.2, -0.1, 1.0, 0.0, 0.0, 0.0)) for name in _ARM}
            continue
        # From hanging arms to the T-pose the arm turns about x, to its side.
        lifted = (_HALF, -sign * _HALF, 0.0, 0.0)
        body = f"{person.name}/{side.lower()}_"
        made[f"{side}Shoulder"] = (f"{body}clavicle", (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
        for name, part in (("UpperArm", "upper_arm"), ("ForeArm", "forearm"), ("Hand", "hand")):
            made[side + name] = (body + part, (0.0, 0.0, 0.0, *lifted))
    return made
