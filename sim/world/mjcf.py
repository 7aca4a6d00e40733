"""Helpers for writing MJCF: elements with numbers at full precision."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final
from xml.etree.ElementTree import Element, SubElement

HAND_BIT: Final = 1
FINGER_BIT: Final = 2
OBJECT_BIT: Final = 4

CONTACT: Final = {
    # Parts of one hand never touch each other, and fingers never touch fingers: neighbours overlap at the joints.
    "hand": {"contype": HAND_BIT, "conaffinity": FINGER_BIT | OBJECT_BIT},
    "finger": {"contype": FINGER_BIT, "conaffinity": HAND_BIT | OBJECT_BIT},
    "object": {"contype": OBJECT_BIT, "conaffinity": HAND_BIT | FINGER_BIT | OBJECT_BIT},
    "none": {"contype": 0, "conaffinity": 0},
}


def add(parent: Element, tag: str, **attributes: object) -> Element:
    """Adds a child element; numbers and sequences of numbers are written so that they read back bit for bit.

    A trailing underscore of a keyword is dropped (`class_`).
    """
    return SubElement(parent, tag, {key.rstrip("_"): text(value) for key, value in attributes.items()})


def text(value: object) -> str:
    """Formats one attribute's value as MJCF text."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Iterable):
        return " ".join(text(item) for item in value)
    return repr(float(value)) if not isinstance(value, int) else str(value)  # type: ignore[arg-type]
