"""The wearer's hand in MJCF: 20 joints, capsule phalanges, the wrist fixed at the origin.

The geometry is the SynGrasp "paradigmatic" hand (sheet human_hand): a right hand, frame `hand` with its
origin at the wrist centre, x toward the little finger, y distal, z dorsal (the palm faces -z).
Names and ranges of the joints come from the control law (`runtime.control.hand.human_hand`). The geometry is written
here a second time on purpose, so that the simulation can check the control law's kinematics.
"""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from runtime.control.hand.human_hand import FINGERS, JOINTS, RANGES
from sim.world.mjcf import CONTACT, add

_BASES: Final = {  # m
    "thumb": (-0.037, 0.045, 0.0),
    "index": (-0.024, 0.073, 0.0),
    "middle": (-0.008, 0.073, 0.0),
    "ring": (0.008, 0.073, 0.0),
    "little": (0.024, 0.073, 0.0),
}
# For each joint: the length along x (m), then quarter turns about x to the next joint's axis.
_LINKS: Final = {
    "thumb": ((0.0, -1), (0.025, 0), (0.015, 1), (0.010, 0)),
    "index": ((0.0, -1), (0.037, 0), (0.030, 0), (0.015, 0)),
    "middle": ((0.0, -1), (0.040, 0), (0.035, 0), (0.017, 0)),
    "ring": ((0.0, -1), (0.037, 0), (0.030, 0), (0.015, 0)),
    "little": ((0.0, -1), (0.027, 0), (0.025, 0), (0.010, 0)),
}
_RADII: Final = {"thumb": (0.011, 0.010, 0.009), "finger": (0.009, 0.008, 0.007)}  # m
_DENSITY: Final = 1100.0  # kg/m^3, soft tissue and bone

# By the joint's position in its finger. The strength gives about 10 N at the fingertip: a gentle grip.
_STRENGTH: Final = (0.5, 0.9, 0.5, 0.3)  # N m
_STIFFNESS: Final = (2.0, 3.0, 2.0, 1.5)  # N m/rad
_ARMATURE: Final = 1e-4  # kg m^2; keeps light end phalanges well conditioned at a 1 ms step
_INERTIA: Final = 2e-4  # kg m^2; armature and flesh at a knuckle, used for critical damping
_SKIN: Final = {"rgba": "0.86 0.69 0.58 1", "friction": (0.9, 0.005, 0.0001)}


def add_hand(world: Element, actuators: Element, strength: float) -> None:
    """Adds bodies, joints `hand/<joint>`, tip sites `hand/<finger>` and actuators `hand/<joint>`.

    Args:
        world: the `worldbody` element.
        actuators: the `actuator` element.
        strength: multiplies every joint's greatest torque.
    """
    box = {"type": "box", "pos": (0.0, 0.036, 0.002), "size": (0.033, 0.034, 0.010)}
    add(world, "geom", name="hand/palm", **box, **CONTACT["hand"], **_SKIN)
    for number, finger in enumerate(FINGERS):
        radii = _RADII["thumb" if finger == "thumb" else "finger"]
        body = world
        # The base's x axis is distal (+y of the hand) and its z axis dorsal: a quarter turn about z.
        place = {"pos": _BASES[finger], "quat": (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))}
        for k, (length, quarter) in enumerate(_LINKS[finger]):
            index = 4 * number + k
            name = f"hand/{JOINTS[index]}"
            body = add(body, "body", name=f"hand/{finger}_{k + 1}", **place)
            joint = {"range": RANGES[index], "armature": _ARMATURE, "damping": 0.002}
            add(body, "joint", name=name, axis="0 0 1", **joint)
            if length > 0.0:
                capsule = {"type": "capsule", "fromto": (0, 0, 0, length, 0, 0), "size": radii[k - 1]}
                add(body, "geom", name=name, density=_DENSITY, **capsule, **CONTACT["hand"], **_SKIN)
            else:  # the two axes of the knuckle meet here; the body between them has no size of its own
                add(body, "inertial", pos="0 0 0", mass=1e-3, diaginertia="1e-7 1e-7 1e-7")
            _add_muscle(actuators, name, k, strength)
            half = quarter * np.pi / 4
            place = {"pos": (length, 0.0, 0.0), "quat": (np.cos(half), np.sin(half), 0.0, 0.0)}
        add(body, "site", name=f"hand/{finger}", pos=place["pos"], size=0.002)


def _add_muscle(actuators: Element, name: str, place: int, strength: float) -> None:
    """Adds a position servo of limited torque whose set-point is a state, moved by a rate in rad/s.

    The set-point is an integrator. So it moves evenly from one of the wearer's targets to the next, however
    many time steps lie between them.
    """
    stiffness, limit = _STIFFNESS[place], _STRENGTH[place] * strength
    damping = 2.0 * np.sqrt(stiffness * _INERTIA)
    add(
        actuators,
        "general",
        name=name,
        joint=name,
        dyntype="integrator",
        gainprm=stiffness,
        biastype="affine",
        biasprm=(0.0, -stiffness, -damping),
        forcerange=(-limit, limit),
    )
