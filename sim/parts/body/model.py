"""A person's masses and shapes, attached to the 59 joints of a capture suit's skeleton.

Masses, centres of mass and radii of gyration of limbs: de Leva 1996 (facts human_body), with the skeleton's own
lengths between joint centres. Heights and breadths: Drillis and Contini 1966. Values from neither source are our own
and marked so. Axes in the T-pose: x to the left, y up, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS, Skeleton
from srl.runtime.contracts.signals import Array

Sex = Literal["male", "female"]
HIP_HEIGHT: Final = 0.530  # share of the standing height
_CHEST: Final = 0.174  # width, share of the height
_DEPTH: Final = 0.65  # depth of the trunk, share of its width (ours)
_FOOT: Final = 0.152  # length, share of the height
_ANKLE: Final = 0.039  # height, share of the height
_HEAD: Final = 0.182  # head and neck, share of the height
_HAND: Final = 0.108  # wrist to fingertip, share of the height
_HEEL: Final = 0.25  # share of the foot's length behind the ankle (ours)
_NECK: Final = 0.15  # share of the mass of head and neck (ours)
_SHOULDER: Final = 0.1  # share of the upper trunk's mass, each side (ours)
_FINGERS: Final = 0.25  # share of the hand's mass, if they move by themselves (ours)
_FINGER_RADIUS: Final = 0.008  # m (ours)
_BONES: Final = (JOINTS - 21) // 2  # number in a hand; they share that mass equally (ours)
_TIP: Final = 0.8  # length of a last phalanx, share of the one before it (ours)
_DENSITY: Final = 1050.0  # kg/m^3, of limbs, for the thickness with which they are drawn

# Mass as a share of the body's; centre of mass as a share of the length from the first landmark; radii of gyration
# (about the sagittal, transverse and longitudinal axis) as shares of the length.
_DE_LEVA: Final[dict[Sex, dict[str, tuple[float, ...]]]] = {
    "male": {
        "upper_arm": (0.0271, 0.5772, 0.285, 0.269, 0.158),
        "forearm": (0.0162, 0.4574, 0.276, 0.265, 0.121),
        "hand": (0.0061, 0.3624, 0.288, 0.235, 0.184),
        "head": (0.0694, 0.5002, 0.303, 0.315, 0.261),
        "upper_trunk": (0.1596,),
        "middle_trunk": (0.1633,),
        "lower_trunk": (0.1117,),
        "thigh": (0.1416, 0.4095, 0.329, 0.329, 0.149),
        "shank": (0.0433, 0.4395, 0.251, 0.246, 0.102),
        "foot": (0.0137, 0.4415, 0.257, 0.245, 0.124),
    },
    "female": {
        "upper_arm": (0.0255, 0.5754, 0.278, 0.260, 0.148),
        "forearm": (0.0138, 0.4559, 0.261, 0.257, 0.094),
        "hand": (0.0056, 0.3427, 0.244, 0.208, 0.154),
        "head": (0.0668, 0.4841, 0.271, 0.295, 0.261),
        "upper_trunk": (0.1545,),
        "middle_trunk": (0.1465,),
        "lower_trunk": (0.1247,),
        "thigh": (0.1478, 0.3612, 0.369, 0.364, 0.162),
        "shank": (0.0481, 0.4352, 0.267, 0.263, 0.092),
        "foot": (0.0129, 0.4014, 0.299, 0.279, 0.139),
    },
}
_LIMBS: Final = {"Arm": "upper_arm", "ForeArm": "forearm", "UpLeg": "thigh", "Leg": "shank"}
# Pieces of the trunk by joint: (segment, share of its mass). Each tree divides the spine in its own way.
_TRUNK: Final[dict[str, dict[str, tuple[str, float]]]] = {
    "axis-neuron": {
        "Hips": ("lower_trunk", 1.0), "Spine": ("middle_trunk", 0.5), "Spine1": ("middle_trunk", 0.5),
        "Spine2": ("upper_trunk", 0.5 - _SHOULDER), "Spine3": ("upper_trunk", 0.5 - _SHOULDER),
        "Neck": ("head", _NECK),
    },
    "axis-studio": {
        "Hips": ("lower_trunk", 1.0), "Spine": ("middle_trunk", 0.4), "Spine1": ("middle_trunk", 0.6),
        "Spine2": ("upper_trunk", 1.0 - 2 * _SHOULDER), "Neck": ("head", _NECK / 2), "Neck1": ("head", _NECK / 2),
    },
}  # fmt: skip


@dataclass(frozen=True)
class Segment:
    """A rigid segment attached to one joint, in the joint's axes.

    Attributes:
        mass: kg.
        com: (3,), m, centre of mass.
        inertia: (3,), kg m^2, about the centre of mass, along the axes.
        shape: "capsule" or "ellipsoid".
        centre: (3,), m, of the shape.
        size: an ellipsoid's half axes (3,), or a capsule's radius and half length, m.
        axis: (3,), a capsule's direction.
    """

    mass: float
    com: Array
    inertia: Array
    shape: Literal["capsule", "ellipsoid"]
    centre: Array
    size: tuple[float, ...]
    axis: Array


def segments(skeleton: Skeleton, offsets: Array, mass: float, sex: Sex, fingers: bool) -> dict[int, Segment]:
    """The segments by joint number. Their masses sum up to de Leva's shares, which is 1 within rounding.

    Args:
        skeleton: the tree.
        offsets: (59, 3), m, each joint in its parent's frame; the hips' height in the T-pose first.
        mass: kg, of the person.
        sex: which of de Leva's sets.
        fingers: whether they move by themselves; otherwise the hand has their mass.
    """
    table, height = _DE_LEVA[sex], float(offsets[0, 1]) / HIP_HEIGHT
    next_joint = {parent: i for i, parent in reversed(list(enumerate(skeleton.parents)))}  # the first child
    found: dict[int, Segment] = {}
    for i, name in enumerate(skeleton.names):
        bare = name.removeprefix("Left").removeprefix("Right")
        along = offsets[next_joint[i]] if i in next_joint else _TIP * offsets[i]
        if name in (trunk := _TRUNK[skeleton.kind]):
            segment, part = trunk[name]
            up = offsets[skeleton.names.index("Spine")] if name == "Hips" else along
            width = (_CHEST if segment != "head" else 0.4 * _CHEST) * height
            found[i] = _disc(part * table[segment][0] * mass, up, width)
        elif name == "Head":
            found[i] = _head(table["head"], mass, height)
        elif bare == "Shoulder":
            found[i] = _rod(_SHOULDER * table["upper_trunk"][0] * mass, along, 0.2 * _CHEST * height)
        elif bare in _LIMBS:
            found[i] = limb(table[_LIMBS[bare]], mass, along)
        elif bare == "Foot":
            found[i] = _foot(table["foot"], mass, height)
        elif bare == "Hand":
            along = along * [1, 0, 0]
            whole = limb(table["hand"], mass, along / np.linalg.norm(along) * _HAND * height)
            left = 1.0 - _FINGERS * fingers
            found[i] = Segment(
                whole.mass * left, whole.com, whole.inertia * left, "ellipsoid", 0.8 * whole.com,
                (0.3 * _HAND * height, 0.012, 0.04), whole.axis,
            )  # fmt: skip
        elif fingers:
            found[i] = _rod(_FINGERS * table["hand"][0] * mass / _BONES, along, _FINGER_RADIUS)
    return found


def limb(row: tuple[float, ...], mass: float, along: Array) -> Segment:
    """A limb that extends to `along` (3,), m, from de Leva's row."""
    part, com, *radii = row
    length = float(np.linalg.norm(along))
    axis = along / length
    long = int(np.argmax(np.abs(axis)))
    # The sagittal axis points forward, also when an arm is lifted sideways; the remaining axis is transverse.
    sagittal = 2 if long != 2 else 1
    inertia = np.empty(3)
    inertia[sagittal], inertia[3 - sagittal - long], inertia[long] = part * mass * (np.array(radii) * length) ** 2
    radius = float(np.sqrt(part * mass / (_DENSITY * np.pi * length)))
    half = max(length / 2 - radius, 0.2 * radius)
    return Segment(part * mass, com * along, inertia, "capsule", along / 2, (radius, half), axis)


def _disc(mass: float, up: Array, width: float) -> Segment:
    """A piece of the trunk: an elliptic cylinder of a given width from its joint to the next."""
    a, b, h = width / 2, width / 2 * _DEPTH, float(np.linalg.norm(up))
    inertia = mass * np.array([b * b / 4 + h * h / 12, (a * a + b * b) / 4, a * a / 4 + h * h / 12])
    return Segment(mass, up / 2, inertia, "ellipsoid", up / 2, (a, 0.65 * h, b), up / h)


def _head(row: tuple[float, ...], mass: float, height: float) -> Segment:
    part, length = (1.0 - _NECK) * row[0] * mass, _HEAD * height
    inertia = part * (np.array([row[3], row[4], row[2]]) * length) ** 2
    centre = np.array([0.0, 0.25 * length, 0.0])
    return Segment(part, centre, inertia, "ellipsoid", centre, (0.045 * height, 0.065 * height, 0.055 * height), centre)


def _foot(row: tuple[float, ...], mass: float, height: float) -> Segment:
    length = _FOOT * height
    whole = limb(row, mass, np.array([0.0, 0.0, length]))
    down = np.array([0.0, -_ANKLE * height / 2, -_HEEL * length])
    size = (0.0275 * height, _ANKLE * height / 2, length / 2)
    return Segment(whole.mass, whole.com + down, whole.inertia, "ellipsoid", whole.centre + down, size, whole.axis)


def _rod(mass: float, along: Array, radius: float) -> Segment:
    length = float(np.linalg.norm(along))
    axis = along / length
    across, lengthways = mass * (length**2 / 12 + radius**2 / 4), mass * radius**2 / 2
    # It lies nearly along one of the axes, so its products of inertia are left out.
    inertia = np.where(np.arange(3) == np.argmax(np.abs(axis)), lengthways, across)
    return Segment(mass, along / 2, inertia, "capsule", along / 2, (radius, max(length / 2 - radius, 0.002)), axis)
