"""The upper body as one description: joints, segments and marker places, for laws and for the simulated person.

24 degrees of freedom in chains with names: `torso` (6), `left_clavicle` (2), `left_arm` (7), and the right ones. Axes
of every frame, standing with the arms hanging, thumbs forward: x forward, y to the left, z up. At zero all frames are
parallel.

The shoulder turns in the order XYZ of these axes: abduction, flexion, rotation about the upper arm's own axis. It is
singular where the upper arm points straight forward. The whole swivel of an arm whose hand is held stays clear of that;
the ISB's order YXY reaches its own singularity there.

Positive angles mean the same on both sides: abduction away from the body, flexion forward, internal rotation,
protraction forward, elevation up, pronation, flexion of the wrist to the palm, deviation to the little finger. The
torso turns by yaw to the left, then leans forward, then leans to its right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Literal

import numpy as np

from srl.runtime.contracts.signals import Array

Side = Literal["left", "right"]
SIDES: Final[tuple[Side, ...]] = ("left", "right")
Vector = tuple[float, float, float]

# Fractions of the stature: Drillis and Contini (1966), as Winter (2009) has them; `palm`, wrist to third knuckle, is de
# Leva's (1996) of men, his women have 0.045. In ANSUR II half the shoulders' breadth is 0.112 to 0.118.
FRACTIONS: Final = {"upper_arm": 0.186, "forearm": 0.146, "palm": 0.0495, "hand": 0.108, "shoulder": 0.129}
"""`shoulder`: the joint's distance from the middle of the body."""

# Per stature, in the chest's frame, for the left side: our choice, from one adult's markers.
_STERNUM: Final = np.array([-0.006, 0.012, 0.0])  # where the clavicle begins, from the jugular notch
_SHOULDER_BACK: Final = -0.048  # the shoulder's joint behind the jugular notch

# Marker places of Plug-in Gait per stature: one adult's (1.679 m), the mean of both sides. On the arm from the
# segment's further end, for the left side. The head's and RBAK (shoulder blade) show no joint of this body.
_TORSO_MARKERS: Final[dict[str, Vector]] = {
    "C7": (-0.080, 0.0, 0.053),
    "T10": (-0.120, 0.0, -0.101),
    "CLAV": (0.004, 0.0, 0.0),
    "STRN": (0.044, 0.0, -0.094),
}
_ARM_MARKERS: Final[dict[str, tuple[str, Vector]]] = {
    "SHO": ("clavicle", (-0.005, -0.005, 0.033)),
    "UPA": ("upper_arm", (0.0, 0.030, 0.053)),
    "ELB": ("upper_arm", (0.003, 0.033, 0.0)),
    "FRM": ("forearm", (-0.031, 0.023, 0.077)),
    "WRA": ("forearm", (0.018, 0.022, 0.005)),
    "WRB": ("forearm", (-0.020, 0.022, 0.001)),
    "FIN": ("hand", (0.0, 0.013, 0.0)),
}

# (name, about, sign for the left side, same sign for both sides, lower, upper in degrees). Our ranges, about those
# of the clinic; those of elbow, forearm and wrist contain the MoBL arm model's.
_CLAVICLE: Final = (("protraction", "z", -1, False, -25, 35), ("elevation", "x", 1, False, -15, 45))
_ARM: Final = (
    ("shoulder_abduction", "x", 1, False, -60, 180),
    ("shoulder_flexion", "y", -1, True, -90, 90),
    ("shoulder_rotation", "z", -1, False, -120, 120),
    ("elbow_flexion", "y", -1, True, -10, 150),
    ("forearm_pronation", "z", -1, False, -90, 90),
    ("wrist_flexion", "x", -1, False, -80, 80),
    ("wrist_deviation", "y", 1, True, -25, 35),
)
_TORSO: Final = (("yaw", "z", -180, 180), ("lean", "y", -40, 90), ("side", "x", -45, 45))
_AXES: Final[dict[str, Vector]] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class BodyJoint:
    """One joint with one degree of freedom; its frame is parallel to its parent's at zero.

    Attributes:
        chain: the chain that it belongs to.
        slides: along its axis, m; else it turns about it, rad.
        axis: in the joint's frame.
        place: m, in the frame of the joint before it.
        parent: index of the joint before it; -1 for the first, which is in the body's frame.
    """

    name: str
    chain: str
    slides: bool
    axis: Vector
    place: Vector
    parent: int
    lower: float
    upper: float


@dataclass(frozen=True)
class Marker:
    """A marker's place: m, in its segment's frame."""

    segment: str
    at: Vector


@dataclass(frozen=True)
class Body:
    """An upper body.

    Segments are `torso`, and per side `left_clavicle`, `left_upper_arm`, `left_forearm`, `left_hand`. The origin of
    each frame is the joint nearer to the chest; of the torso's, which is called the chest's frame, the jugular notch.

    Attributes:
        sides: the arms it has.
        sternum: m, by side, where the clavicle begins, in the chest's frame.
        shoulder: m, by side, the shoulder's joint from there while the clavicle rests.
        sizes: m, of `upper_arm`, `forearm`, `palm` (wrist to third knuckle) and `hand` (to the fingertip), by side.
        markers: by name.
    """

    sides: tuple[Side, ...]
    sternum: Mapping[Side, Vector]
    shoulder: Mapping[Side, Vector]
    sizes: Mapping[str, Mapping[Side, float]]
    markers: Mapping[str, Marker]

    @cached_property
    def joints(self) -> tuple[BodyJoint, ...]:
        """Every joint, a parent before its children."""
        made: list[BodyJoint] = []
        for axis in "xyz":
            made.append(
                BodyJoint(f"torso_{axis}", "torso", True, _AXES[axis], (0.0,) * 3, len(made) - 1, -np.inf, np.inf)
            )
        for name, axis, low, high in _TORSO:
            made.append(_turn(f"torso_{name}", "torso", _AXES[axis], (0.0, 0.0, 0.0), len(made) - 1, low, high))
        chest = len(made) - 1
        for side in self.sides:
            parent, m = chest, 1 if side == "left" else -1
            places: dict[str, Vector] = {
                "protraction": self.sternum[side],
                "shoulder_abduction": self.shoulder[side],
                "elbow_flexion": (0.0, 0.0, -self.sizes["upper_arm"][side]),
                "wrist_flexion": (0.0, 0.0, -self.sizes["forearm"][side]),
            }
            for chain, rows in (("clavicle", _CLAVICLE), ("arm", _ARM)):
                for name, about, sign, same, low, high in rows:
                    x, y, z = _AXES[about]
                    s = sign if same else sign * m
                    full = f"{side}_{chain}_{name}" if chain == "clavicle" else f"{side}_{name}"
                    place = places.get(name, (0.0, 0.0, 0.0))
                    made.append(_turn(full, f"{side}_{chain}", (s * x, s * y, s * z), place, parent, low, high))
                    parent = len(made) - 1
        return tuple(made)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The joints' names."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def chains(self) -> dict[str, tuple[int, ...]]:
        """The joints of each chain: `torso`, `right_clavicle`, `right_arm` and so on."""
        found: dict[str, tuple[int, ...]] = {}
        for i, joint in enumerate(self.joints):
            found[joint.chain] = (*found.get(joint.chain, ()), i)
        return found

    @cached_property
    def segments(self) -> dict[str, int]:
        """The joint behind which each segment is."""
        found = {"torso": self.names.index("torso_side")}
        ends = {"clavicle": "clavicle_elevation", "upper_arm": "shoulder_rotation", "forearm": "forearm_pronation"}
        for side in self.sides:
            for segment, joint in {**ends, "hand": "wrist_deviation"}.items():
                found[f"{side}_{segment}"] = self.names.index(f"{side}_{joint}")
        return found

    @cached_property
    def ranges(self) -> Array:
        """(n, 2): lower and upper limit of each joint, rad; none (inf) for the torso's x, y, z, m."""
        return np.array([[joint.lower, joint.upper] for joint in self.joints])

    def grip(self, side: Side) -> Vector:
        """The middle of the palm, m, in the frame of the hand: whose pose the laws take for that of the hand."""
        return (0.0, 0.0, -self.sizes["palm"][side])

    def forward(self, q: Sequence[float] | Array) -> dict[str, Array]:
        """The pose (4, 4) of each segment, m, at q (n,). Simple and slow: for checks."""
        poses: list[Array] = []
        for joint, value in zip(self.joints, q, strict=True):
            place = np.eye(4)
            place[:3, 3] = joint.place
            step = np.eye(4)
            if joint.slides:
                step[:3, 3] = value * np.array(joint.axis)
            else:
                x, y, z = joint.axis
                K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
                step[:3, :3] += np.sin(value) * K + (1.0 - np.cos(value)) * K @ K
            before = poses[joint.parent] if joint.parent >= 0 else np.eye(4)
            poses.append(before @ place @ step)
        return {segment: poses[i] for segment, i in self.segments.items()}

    def model(self) -> Any:
        """A `pinocchio.Model` with these joints, in this order; a frame for each segment."""
        import pinocchio as pin

        model = pin.Model()
        model.name = "body"
        for joint in self.joints:
            kind = pin.JointModelPrismaticUnaligned if joint.slides else pin.JointModelRevoluteUnaligned
            limits = [np.array([v]) for v in (np.inf, np.inf, joint.lower, joint.upper)]
            placement = pin.SE3(np.eye(3), np.array(joint.place))
            model.addJoint(joint.parent + 1, kind(np.array(joint.axis)), placement, joint.name, *limits)
        for segment, i in self.segments.items():
            model.addFrame(pin.Frame(segment, i + 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        return model


def _turn(
    name: str, chain: str, axis: Vector, place: Sequence[float], parent: int, lower: float, upper: float
) -> BodyJoint:
    x, y, z = (float(v) for v in place)
    return BodyJoint(name, chain, False, axis, (x, y, z), parent, float(np.deg2rad(lower)), float(np.deg2rad(upper)))


def lengths(stature: float) -> dict[str, float]:
    """The lengths of an average adult of this stature, m."""
    return {name: fraction * stature for name, fraction in FRACTIONS.items()}


def average(stature: float, sides: Sequence[Side] = SIDES) -> Body:
    """The body of an average adult with the marker places of one, scaled by the stature (m)."""
    size = lengths(stature)
    m = {"left": 1.0, "right": -1.0}
    sternum: dict[Side, Vector] = {s: _scaled(_STERNUM * (1.0, m[s], 1.0), stature) for s in sides}
    shoulder: dict[Side, Vector] = {
        s: (_SHOULDER_BACK * stature - sternum[s][0], m[s] * size["shoulder"] - sternum[s][1], -sternum[s][2])
        for s in sides
    }
    markers = {name: Marker("torso", _scaled(at, stature)) for name, at in _TORSO_MARKERS.items()}
    for s in sides:
        ends: dict[str, Vector] = {
            "clavicle": shoulder[s],
            "upper_arm": (0.0, 0.0, -size["upper_arm"]),
            "forearm": (0.0, 0.0, -size["forearm"]),
            "hand": (0.0, 0.0, -size["palm"]),
        }
        for name, (segment, place) in _ARM_MARKERS.items():
            at = np.array(ends[segment]) + np.array(place) * (1.0, m[s], 1.0) * stature
            markers[f"{s[0].upper()}{name}"] = Marker(f"{s}_{segment}", _scaled(at, 1.0))

    sizes = {name: dict.fromkeys(sides, size[name]) for name in ("upper_arm", "forearm", "palm", "hand")}
    return Body(tuple(sides), sternum, shoulder, sizes, markers)


def _scaled(v: Sequence[float] | Array, factor: float) -> Vector:
    x, y, z = (float(e) * factor for e in v)
    return (x, y, z)
