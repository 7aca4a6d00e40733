"""The robotic sixth finger in MJCF: abduction servo at the wrist, three pitch modules (sheet human_hand)."""

from __future__ import annotations

import math
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from runtime.control.hand.human_hand import FINGER_JOINTS
from sim.parts.hand.servo import ServoConfig, add_servo
from sim.world.mjcf import CONTACT, add


class FingerConfig(BaseModel):
    """One extra finger: where it is worn and how it is built. Defaults: the finger worn opposite the palm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(default="finger", pattern=r"^[a-z][a-z0-9_]*$")
    origin: tuple[float, float, float] = Field(default=(0.0, -0.020, -0.030), description="m, the base in frame hand")
    x_axis: tuple[float, float, float] = Field(default=(0.0, 0.0, -1.0), description="where the straight finger points")
    z_axis: tuple[float, float, float] = Field(default=(0.0, 1.0, 0.0), description="the abduction axis")
    links: tuple[float, float, float, float] = Field(
        default=(0.015, 0.042, 0.042, 0.042),
        description="m, abduction axis to first pitch axis, then the modules",
    )
    lower: tuple[float, float, float, float] = Field(
        default=(-math.pi / 3, -math.pi / 2, -math.pi / 2, -math.pi / 2), description="rad"
    )
    upper: tuple[float, float, float, float] = Field(
        default=(math.pi / 3, math.pi / 2, math.pi / 2, math.pi / 2), description="rad"
    )
    servo: ServoConfig = ServoConfig()


_MODULE: Final = (0.033, 0.016)  # m, width and thickness; the length is the link's
_MODULE_MASS: Final = 0.015  # kg
_BRACKET_MASS: Final = 0.035  # kg; with three modules, the finger's 80 g
_PAD: Final = {"rgba": "0.25 0.45 0.75 1", "friction": (1.0, 0.005, 0.0001)}  # silicone


def add_finger(world: Element, actuators: Element, finger: FingerConfig) -> None:
    """Adds bodies, joints `<name>/<joint>`, their servos and the tip's site `<name>`.

    DH rows (alpha, a): (pi/2, links[0]), (0, links[1]), (0, links[2]), (0, links[3]). Positive flexion closes
    toward the fingers (+y of the hand), positive abduction leans toward the thumb's side.
    """
    body = world
    place: dict[str, object] = {"pos": finger.origin, "xyaxes": (*finger.x_axis, *_y_axis(finger))}
    for k, length in enumerate(finger.links):
        name = f"{finger.name}/{FINGER_JOINTS[k]}"
        body = add(body, "body", name=name, **place)
        add_servo(body, actuators, name, (finger.lower[k], finger.upper[k]), finger.servo)
        if k == 0:
            # The bracket is inside the bracelet, so nothing can touch it.
            size = {"type": "box", "pos": (0.0, 0.0, 0.0), "size": (0.008, 0.012, 0.012)}
            add(body, "geom", mass=_BRACKET_MASS, **size, **CONTACT["none"], rgba="0.2 0.2 0.2 1")
        else:
            half = (length / 2, _MODULE[1] / 2, _MODULE[0] / 2)
            box = {"type": "box", "pos": (length / 2, 0.0, 0.0), "size": half}
            add(body, "geom", name=name, mass=_MODULE_MASS, **box, **CONTACT["finger"], **_PAD)
        root = np.sqrt(0.5)
        place = {
            "pos": (length, 0.0, 0.0),
            "quat": (root, root, 0.0, 0.0) if k == 0 else (1.0, 0.0, 0.0, 0.0),
        }
    add(body, "site", name=finger.name, pos=place["pos"], size=0.002)


def _y_axis(finger: FingerConfig) -> tuple[float, ...]:
    return tuple(float(v) for v in np.cross(finger.z_axis, finger.x_axis))
