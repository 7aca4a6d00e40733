"""Where the parts of a world stand: the profile's tree of frames, carried by the parts that move."""

from __future__ import annotations

from collections.abc import Container, Mapping
from xml.etree.ElementTree import Element

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.frames import IDENTITY, Frames
from srl.runtime.contracts.rotation import Pose, composed
from srl.sim.world.part import Mjcf, Part, Spot


def build(mjcf: Mjcf, parts: Mapping[str, Part], frames: Frames) -> None:
    """Builds every part on the body that carries its frame.

    A part carries the frame with its own name: it stands there unless it says otherwise, and what hangs on that frame
    moves with it. A frame that hangs on no part is fixed in the world.

    Raises:
        WiringError: a frame or body isn't there, is measured and carried by no part, or isn't connected with the
            frames of the other parts.
    """
    waiting = dict(parts)
    roots: dict[str, str] = {}  # of the fixed frames that are used, and the part that uses it
    while waiting:
        lacking = {name: _build(mjcf, part, frames, waiting, roots) for name, part in waiting.items()}
        built = [name for name, frame in lacking.items() if frame is None]
        if not built:
            raise _stuck({name: frame for name, frame in lacking.items() if frame is not None}, mjcf, frames)
        for name in built:
            del waiting[name]


def _build(mjcf: Mjcf, part: Part, frames: Frames, waiting: Mapping[str, Part], roots: dict[str, str]) -> str | None:
    """Builds the part, unless what carries its frame isn't there yet: returns the frame or body that is lacking."""
    found = _find(mjcf, part, frames, waiting, roots)
    if isinstance(found, str):
        return found
    body, pose, part.carrier = found
    part.stand = composed(pose, part.config.off_by.placed())
    before = len(mjcf.bodies)
    part.build(mjcf, body)
    first = next(iter([*mjcf.bodies.values()][before:]), None)
    if first is not None:
        mjcf.carried.setdefault(part.name, (first, IDENTITY))
    return None


def _find(
    mjcf: Mjcf, part: Part, frames: Frames, waiting: Mapping[str, Part], roots: dict[str, str]
) -> tuple[Element, Pose, str] | str:
    """The body that carries the part's frame, the frame's pose in it, and the part whose body it is ("" for the world).

    Where a frame or body is lacking: its name.
    """
    at = part.config.at
    if at is None:
        at = part.name if part.name in frames.entries else None
    elif at != part.name and part.name in frames.entries and not _unseen(frames, part.name, {*mjcf.carried, *waiting}):
        problem = f"the profile says where '{part.name}' is, frames.{part.name}, and this says it again"
        remedy = "Leave `at:` out; `off_by:` makes the world differ from what the profile says"
        raise WiringError(_place(part.name), problem, remedy)
    pose = IDENTITY
    if isinstance(at, Spot):
        pose, at = at.placed(), at.parent
    frame = at
    while frame is not None:
        if frame != part.name:
            if frame in mjcf.bodies:
                return mjcf.bodies[frame], pose, _owner(frame)
            if frame in mjcf.carried:
                body, inside = mjcf.carried[frame]
                return body, composed(inside, pose), frame
            if _owner(frame) in waiting:
                return frame
        entry = frames.entries.get(frame)
        if entry is None:
            return frame
        if entry.pose is not None and frame != part.name:
            problem = f"the frame '{frame}' moves: '{entry.pose}' measures it, and no part of the world carries it"
            raise WiringError(_place(part.name), problem, f"Give the part that moves so the name '{frame}'")
        pose = composed(entry.placed(), pose)
        if entry.parent is None:
            roots.setdefault(frame, part.name)
            if len(roots) > 1:
                (a, one), (b, other) = list(roots.items())[:2]
                problem = f"it stands in '{b}', and '{one}' in '{a}', which nothing connects"
                raise WiringError(_place(other), problem, f"Say under `frames:` where '{b}' is: give it a parent")
        frame = entry.parent
    return mjcf.worldbody, pose, ""


def _unseen(frames: Frames, name: str, parts: Container[str]) -> bool:
    """Whether a pose is measured on the frame's way to its root, and no part of the world carries that one.

    Then the profile says what is seen, and only the part itself can say what is so.
    """
    above = frames.entries[name].parent
    while above in frames.entries and above not in parts:
        entry = frames.entries[above]
        if entry.pose is not None:
            return True
        above = entry.parent
    return frames.entries[name].pose is not None


def _stuck(lacking: Mapping[str, str], mjcf: Mjcf, frames: Frames) -> WiringError:
    """Why none of these parts can be built; `lacking` says by part what it stands on."""
    for name, frame in lacking.items():
        if _owner(frame) not in lacking:
            names = {*frames.entries, *mjcf.carried, *mjcf.bodies}
            return WiringError(_place(name), f"no frame and no body is called '{frame}'", nearest(frame, names))
    way = [next(iter(lacking))]  # from a part to the one on which it stands, until one comes again
    while (on := _owner(lacking[way[-1]])) not in way:
        way.append(on)
    circle = way[way.index(on) :]
    if len(circle) == 1:
        problem = f"it stands on itself, at '{lacking[on]}'"
        return WiringError(_place(on), problem, "Name a frame of `frames:`, or a body of another part")
    problem = f"parts stand on each other: {' -> '.join([*circle, on])}"
    return WiringError(_place(on), problem, "Let one of them stand in the world")


def _owner(frame: str) -> str:
    """The part whose frame or body this is, if it is a part's."""
    return frame.partition("/")[0]


def _place(name: str) -> str:
    return f"sim.parts.{name}.at"
