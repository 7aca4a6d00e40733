"""Converts named joints and sensors of other hands to the model's 20 joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from srl.drivers.cyberglove.protocol import LABELS, LABELS_22
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import JOINTS

Terms = tuple[tuple[str, float], ...]

_GLOVE: Final[Mapping[str, Terms]] = {
    # Sheet human_hand, "CyberGlove -> model": abduction sensors lie between neighbours, middle is zero.
    "thumb_tm_abduction": (("s3", 1.0),),
    "thumb_tm_flexion": (("s0", 1.0),),
    "thumb_mcp_flexion": (("s1", 1.0),),
    "thumb_ip_flexion": (("s2", 1.0),),
    "index_mcp_abduction": (("s10", 1.0),),
    "index_mcp_flexion": (("s4", 1.0),),
    "index_pip_flexion": (("s5", 1.0),),
    "index_dip_flexion": (("s6", 1.0),),
    "middle_mcp_flexion": (("s7", 1.0),),
    "middle_pip_flexion": (("s8", 1.0),),
    "middle_dip_flexion": (("s9", 1.0),),
    "ring_mcp_abduction": (("s14", -1.0),),
    "ring_mcp_flexion": (("s11", 1.0),),
    "ring_pip_flexion": (("s12", 1.0),),
    "ring_dip_flexion": (("s13", 1.0),),
    "little_mcp_abduction": (("s14", -1.0), ("s18", -1.0)),
    "little_mcp_flexion": (("s15", 1.0),),
    "little_pip_flexion": (("s16", 1.0),),
    "little_dip_flexion": (("s17", 1.0),),
}


def _adroit() -> dict[str, Terms]:
    """The terms for Adroit: J3 abducts toward the thumb; J2, J1, J0 flex.

    With other signs of J3, neighbouring fingers would pass through each other in the recorded door openings.
    Of the thumb, J4 turns it across the palm, J3 lifts it out of the palm's plane, J1 and J0 flex negatively.
    J2 of the thumb (a hub of +-15 degrees), J4 of the little finger (metacarpal) and the wrist have no
    counterpart in the model.
    """
    terms: dict[str, Terms] = {
        "thumb_tm_abduction": (("THJ4", -1.0),),
        "thumb_tm_flexion": (("THJ3", 1.0),),
        "thumb_mcp_flexion": (("THJ1", -1.0),),
        "thumb_ip_flexion": (("THJ0", -1.0),),
    }
    places = ("mcp_abduction", "mcp_flexion", "pip_flexion", "dip_flexion")
    for finger, code in (("index", "FF"), ("middle", "MF"), ("ring", "RF"), ("little", "LF")):
        for number, joint in zip((3, 2, 1, 0), places, strict=True):
            terms[f"{finger}_{joint}"] = ((f"{code}J{number}", 1.0),)
    return terms


SCHEMES: Final[Mapping[str, Mapping[str, Terms]]] = {
    "model joints": {joint: ((joint, 1.0),) for joint in JOINTS},
    "CyberGlove sensors": _GLOVE,
    "Adroit joints": _adroit(),
}


def to_model(names: Sequence[str], values: Array) -> Array | None:
    """Angles of the model's joints (n, 20), rad, from columns (n, m), rad, named in one of the SCHEMES.

    Joints that weren't measured stay at zero, except DIP joints, which follow at 2/3 of their PIP joint.

    Returns:
        None if the names belong to no scheme (fewer than five joints found).
    """
    names = numbered(names)
    column = {name: i for i, name in enumerate(names)}
    best: Array | None = None
    most = 4
    for scheme in SCHEMES.values():
        out = np.zeros((len(values), len(JOINTS)))
        found = []
        for j, joint in enumerate(JOINTS):
            terms = scheme.get(joint, ())
            if terms and all(source in column for source, _ in terms):
                found.append(joint)
                out[:, j] = sum(gain * values[:, column[source]] for source, gain in terms)
            elif joint.endswith("dip_flexion"):
                out[:, j] = out[:, j - 1] * 2 / 3
        if len(found) > most:
            best, most = out, len(found)
    return best


def unused(names: Sequence[str]) -> list[str]:
    """Those of these names from which `to_model` takes nothing: a palm's, a wrist's, and what no scheme knows."""
    known = numbered(names)
    schemes = [
        {source for terms in scheme.values() if all(s in known for s, _ in terms) for source, _ in terms}
        for scheme in SCHEMES.values()
    ]
    used = max(schemes, key=len)
    return [name for name, number in zip(names, known, strict=True) if number not in used]


def numbered(names: Sequence[str]) -> list[str]:
    """Converts names of glove sensors, by label or number, to the numbers s0..s21 of a glove with 22 sensors.

    If the numbers are exactly s0..s17, the glove has 18 sensors and none at the DIP joints.
    """
    number = {label: f"s{i}" for i, label in enumerate(LABELS_22)}
    if {name for name in names if name[:1] == "s" and name[1:].isdigit()} == {f"s{i}" for i in range(18)}:
        number |= {f"s{i}": number[label] for i, label in enumerate(LABELS[18])}
    return [number.get(name, name) for name in names]


def _glove_of_hand() -> Array:
    thumb, index, middle, ring, little = np.eye(20).reshape(5, 4, 20)
    s = np.zeros((22, 20))
    s[0], s[1], s[2], s[3] = thumb[1], thumb[2], thumb[3], thumb[0]
    s[4:7], s[7:10], s[11:14], s[15:18] = index[1:], middle[1:], ring[1:], little[1:]
    s[10], s[14], s[18] = index[0] - middle[0], middle[0] - ring[0], ring[0] - little[0]
    return s


GLOVE_OF_HAND: Final = _glove_of_hand()
"""(22, 20): the sensors' angles from those of the hand's joints, the inverse of the glove's scheme.

Abduction sensors measure how far neighbours are apart; palm arch and wrist, which the model doesn't have,
stay at zero.
"""


def to_glove(position: Array) -> Array:
    """The angles (22,), rad, of a glove's 22 sensors for a hand's joint angles (20,), rad."""
    return GLOVE_OF_HAND @ position
