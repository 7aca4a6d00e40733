"""What a control law says about the transforms that it needs: between the frames of its ports.

Only the wiring knows which frames these are. The law is given each transform as a pose, `self.transform[name]`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Place:
    """A frame, as a law can name it. Made by the functions below."""

    kind: Literal["in", "of", "device", "frame"]
    name: str  # of the port, or of the frame
    link: str = ""

    def __str__(self) -> str:
        if self.kind == "frame":
            return f"frame '{self.name}'"
        where = f"link '{self.link}' of " if self.link else ""
        of = {"in": "the frame of", "of": "the frame that is measured by", "device": f"{where}the device of"}
        return f"{of[self.kind]} `{self.name}`"


def coordinates(port: str) -> Place:
    """The frame in which the port's signal is given."""
    return Place("in", port)


def measured(port: str) -> Place:
    """The frame whose pose (or twist) the port's signal is."""
    return Place("of", port)


def device(port: str, link: str = "") -> Place:
    """The own frame of the device that gives the port's signal, or one of its links: an arm's base, its flange."""
    return Place("device", port, link)


def frame(name: str) -> Place:
    """A frame of the profile's tree, by its name (an option of the law)."""
    return Place("frame", name)


@dataclass(frozen=True)
class Transform:
    """The pose of one frame in another.

    Attributes:
        name: the key in `Controller.transform`.
        of: the frame whose pose it is.
        into: the frame in which it is given: p_into = T p_of.
        text: what it is, for people: "the arm's base in the mobile base's frame".
        moves: the law reads it in each `update`, so measured frames may be on the way; else it must be fixed.
    """

    name: str
    of: Place
    into: Place
    text: str
    moves: bool = False
