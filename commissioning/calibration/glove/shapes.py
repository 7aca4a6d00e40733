"""The shapes of a hand by which a glove is calibrated, and which sensor each is for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from pydantic import Field

from srl.runtime.contracts.options import Options

FLAT, FIST, SPREAD, THUMB, AGAIN = 1, 2, 3, 4, 9
FINGERS: Final = ("index", "middle", "ring", "pinkie")
ALONE: Final = {finger: 5 + i for i, finger in enumerate(FINGERS)}
"""The shape in which a finger alone is bent."""
LAST: Final = AGAIN


class Angles(Options):
    """What the joints have in the shapes; nothing measures them. In the fist: as of the driver's average hand."""

    mpj: float = Field(1.45, ge=0.5, le=2.0, description="rad, of a finger's root in the fist")
    pij: float = Field(1.75, ge=0.5, le=2.2, description="rad, of its middle joint in the fist")
    dij: float = Field(1.1, ge=0.3, le=1.6, description="rad, of its end joint in the fist")
    thumb_roll: float = Field(1.2, ge=0.3, le=1.8, description="rad, of the thumb across the palm")
    thumb_mpj: float = Field(0.9, ge=0.3, le=1.5, description="rad, of its root there")
    thumb_ij: float = Field(1.2, ge=0.3, le=1.6, description="rad, of its end joint there")
    apart: float = Field(0.3, ge=0.1, le=0.6, description="rad, between two fingers that are spread")
    thumb_apart: float = Field(0.5, ge=0.2, le=1.2, description="rad, of the thumb from the hand, spread")


@dataclass(frozen=True)
class Shape:
    """A shape. Attributes: `name`; `task`, what the person does; `angles`, rad by sensor, all others are 0."""

    name: str
    task: str
    angles: Mapping[str, float]


def shapes(known: Angles) -> dict[int, Shape]:
    """All, by number, in their order."""
    flat = "Lay the hand flat: fingers straight and together, thumb alongside, wrist straight"
    bent = {f: {f"{f}_{joint}": getattr(known, joint) for joint in ("mpj", "pij", "dij")} for f in FINGERS}
    fist = {name: angle for joints in bent.values() for name, angle in joints.items()}
    spread = {
        "thumb_abduction": known.thumb_apart, "middle_index_abduction": known.apart,
        "ring_middle_abduction": known.apart, "pinkie_ring_abduction": known.apart,
    }  # fmt: skip
    thumb = {name: getattr(known, name) for name in ("thumb_roll", "thumb_mpj", "thumb_ij")}
    found = {
        FLAT: Shape("flat", flat, {}),
        FIST: Shape("fist", "Make a fist, the thumb straight outside of it", fist),
        SPREAD: Shape("spread", "Straighten and spread the fingers and the thumb as far as they go", spread),
        THUMB: Shape("thumb", "Fingers straight; lay the thumb across the palm and bend it fully", thumb),
    }
    for finger, number in ALONE.items():
        task = f"Bend the {finger} finger alone, as far as it goes; let the others be as straight as they can"
        found[number] = Shape(finger, task, bent[finger])
    found[AGAIN] = Shape("flat again", flat, {})
    return found


def bent_in(sensor: str) -> int | None:
    """The shape in which a sensor's joint is bent by a known angle; None: there is none."""
    if sensor.endswith("abduction"):
        return SPREAD
    if sensor.startswith("thumb_"):
        return THUMB
    return FIST if sensor.partition("_")[0] in FINGERS else None
