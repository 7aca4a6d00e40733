"""The robotic sixth finger in MJCF: abduction servo at the wrist, three pitch modules (sheet human_hand)."""

from __future__ import annotations

from typing import Final
from xml.etree.ElementTree import Element

from srl.runtime.models.models import FingerModel
from srl.sim.parts.hand.servo import ServoConfig, add_servo
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import turned

_MODULE: Final = (0.042, 0.033, 0.016)  # m, length, width and thickness; another length has another mass
_MODULE_MASS: Final = 0.015  # kg
_BRACKET_MASS: Final = 0.035  # kg; with three modules, the finger's 80 g
_PAD: Final = {"rgba": "0.25 0.45 0.75 1", "friction": (1.0, 0.005, 0.0001)}  # silicone


def add_finger(mjcf: Mjcf, base: Element, name: str, finger: FingerModel, servo: ServoConfig) -> None:
    """Adds bodies, joints `<name>/<joint>`, their servos and the tip's site `<name>/tip`.

    The first link is the bracket that holds the finger, unless it is the only one; each of the others is a module.

    Args:
        base: the body in whose frame the chain begins.
    """
    body, place = base, turned(0.0, 0.0)
    for k, ((alpha, length), joint) in enumerate(zip(finger.rows, finger.names, strict=True)):
        full = f"{name}/{joint}"
        body = add(body, "body", name=full, **place)
        add_servo(body, mjcf.actuator, full, (finger.lower[k], finger.upper[k]), servo)
        if k == 0 and len(finger.rows) > 1:
            # The bracket is inside the bracelet, so nothing can touch it.
            size = {"type": "box", "pos": (0.0, 0.0, 0.0), "size": (0.008, 0.012, 0.012)}
            add(body, "geom", mass=_BRACKET_MASS, **size, **CONTACT["none"], rgba="0.2 0.2 0.2 1")
        elif length == 0.0:  # two axes that meet
            add(body, "inertial", pos="0 0 0", mass=1e-3, diaginertia="1e-7 1e-7 1e-7")
        else:
            half = (abs(length) / 2, _MODULE[2] / 2, _MODULE[1] / 2)
            box = {"type": "box", "pos": (length / 2, 0.0, 0.0), "size": half}
            mass = _MODULE_MASS * abs(length) / _MODULE[0]
            add(body, "geom", name=full, mass=mass, **box, **CONTACT["finger"], **_PAD)
        place = turned(alpha, length)
    add(body, "site", name=f"{name}/tip", pos=place["pos"], size=0.002)
