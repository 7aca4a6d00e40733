"""The wearer's hand in MJCF: 20 joints, capsule phalanges, a palm, from the description that the laws use."""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from srl.runtime.models.human_hand import FINGERS
from srl.runtime.models.models import HandModel
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import placed, turned

# Of the unscaled model, m.
PALM: Final = {"pos": (0.0, 0.036, 0.002), "size": (0.033, 0.034, 0.010)}
RADII: Final = {"thumb": (0.011, 0.010, 0.009), "finger": (0.009, 0.008, 0.007)}
_DENSITY: Final = 1100.0  # kg/m^3, soft tissue and bone

# By the joint's position in its finger. The strength gives about 10 N at the fingertip: a gentle grip.
_STRENGTH: Final = (0.5, 0.9, 0.5, 0.3)  # N m
_STIFFNESS: Final = (2.0, 3.0, 2.0, 1.5)  # N m/rad
_ARMATURE: Final = 1e-4  # kg m^2; keeps light end phalanges well conditioned at a 1 ms step
_INERTIA: Final = 2e-4  # kg m^2; armature and flesh at a knuckle, used for critical damping
_SKIN: Final = {"rgba": "0.86 0.69 0.58 1", "friction": (0.9, 0.005, 0.0001)}


def add_hand(mjcf: Mjcf, base: Element, name: str, hand: HandModel, strength: float) -> None:
    """Adds bodies, joints `<name>/<joint>`, tip sites `<name>/<finger>` and actuators `<name>/<joint>`.

    Sizes grow with the hand's length, so masses with its cube. Strength, stiffness and damping stay.

    Args:
        base: the body whose frame is the hand's.
        strength: multiplies every joint's greatest torque.
    """
    scale = hand.scale
    palm = {key: tuple(scale * v for v in value) for key, value in PALM.items()}
    add(base, "geom", name=f"{name}/palm", type="box", density=_DENSITY, **palm, **CONTACT["hand"], **_SKIN)
    joints = zip(hand.names, hand.ranges.tolist(), strict=True)
    for finger, origin, rows in zip(FINGERS, *hand.geometry(), strict=True):
        radii = iter(RADII["thumb" if finger == "thumb" else "finger"])
        body, place = base, placed(origin)
        for k, (alpha, length) in enumerate(rows.tolist()):
            joint, limits = next(joints)
            full = f"{name}/{joint}"
            body = add(body, "body", name=f"{name}/{finger}_{k + 1}", **place)
            add(body, "joint", name=full, axis="0 0 1", range=limits, armature=_ARMATURE, damping=0.002)
            if length > 0.0:
                capsule = {"type": "capsule", "fromto": (0, 0, 0, length, 0, 0), "size": scale * next(radii)}
                add(body, "geom", name=full, density=_DENSITY, **capsule, **CONTACT["hand"], **_SKIN)
            else:  # the two axes of the knuckle meet here; the body between them has no size of its own
                add(body, "inertial", pos="0 0 0", mass=1e-3, diaginertia="1e-7 1e-7 1e-7")
            _add_muscle(mjcf.actuator, full, k, strength)
            place = turned(alpha, length)
        add(body, "site", name=f"{name}/{finger}", pos=place["pos"], size=0.002)


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
