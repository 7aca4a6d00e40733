"""Reads a URDF: its links and joints, and of them what a picture needs. `urdf_arm` makes the laws' model of it.

URDF is described at https://wiki.ros.org/urdf/XML. No xacro: a file that has it must be expanded first.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.linkage import DARK, Link, Linkage, Solid
from srl.runtime.contracts.rotation import Pose, Vector

FORMATS: Final = (".dae", ".stl", ".obj", ".glb", ".gltf")  # meshes that the viewer reads
MOST: Final = 1000  # links
LARGEST: Final = 100 << 20  # bytes of a mesh
FAR: Final = 1e6  # m or rad; with larger numbers a picture isn't finite any more
_MOVES: Final = ("revolute", "continuous", "prismatic")
_EXPAND: Final = "Expand xacro first (`xacro FILE.xacro > FILE.urdf`), and name a URDF"


@dataclass(frozen=True)
class Urdf:
    """What was read.

    Attributes:
        linkage: all its links, with rods for shapes; link 0 is the file's root, and hangs on the robot's own frame.
        packages: folders in which `package://` begins.
        lacking: meshes of links that aren't there, or aren't of a form that is drawn.
    """

    linkage: Linkage
    packages: tuple[Path, ...]
    lacking: tuple[str, ...]


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of the file.

    Attributes:
        kind: as in the file: revolute, continuous, prismatic, fixed, floating, planar.
        pose: of its frame at zero in the parent link's.
        axis: in its own frame, of length 1.
        mimic: the joint that it follows, factor and offset (rad or m).
        limits: lower, upper (rad or m), velocity (rad/s or m/s), effort (N m or N), as far as the file has them.
        friction: N m or N.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose
    axis: Vector
    mimic: tuple[str, float, float] | None
    limits: dict[str, float]
    friction: float

    @property
    def moves(self) -> bool:
        """Whether it has one degree of freedom."""
        return self.kind in _MOVES


@dataclass(frozen=True)
class UrdfTree:
    """The links and joints of a file.

    Attributes:
        links: elements by name.
        before: the joint before each link but the root.
        place: the file, for errors.
        name: the robot's.
    """

    links: dict[str, Element]
    joints: list[UrdfJoint]
    before: dict[str, UrdfJoint]
    place: Path
    name: str

    def way(self, link: str) -> list[UrdfJoint]:
        """The joints from the root to a link."""
        return _way(link, self.before, self.place, len(self.links))

    def ordered(self) -> list[str]:
        """The links, each after the one that it hangs on."""
        return _ordered(self.links, self.before, self.joints)


def tree(content: bytes, file: Path) -> UrdfTree:
    """Reads the links and joints of a URDF. Raises OptionError: it can't be used."""
    try:
        root = _parsed(content)
    except (expat.ExpatError, UnicodeDecodeError, LookupError, ValueError) as error:
        raise OptionError(f"{file} isn't XML: {error}", "Name a URDF") from None
    if root.tag != "robot":
        raise OptionError(f"{file} isn't a URDF: it begins with <{root.tag}>", "Name a URDF")
    if _is_xacro(root):
        raise OptionError(f"{file} is xacro, not yet a URDF", _EXPAND)
    links = {_name(e, file): e for e in root.findall("link")}
    if not 0 < len(links) <= MOST:
        raise OptionError(f"{file} has {len(links)} links; 1 to {MOST} are read", _EXPAND)
    for kind in ("link", "joint"):
        names = Counter(_name(e, file) for e in root.findall(kind))
        if twice := next((name for name, count in names.items() if count > 1), None):
            raise OptionError(f"{file}: two {kind}s are called '{twice}'", "Give each a name of its own in the URDF")
    joints = _followed([_joint(e, file) for e in root.findall("joint")], file)
    return UrdfTree(links, joints, _tree(joints, links, file), file, root.get("name") or file.stem)


def _is_xacro(root: Element) -> bool:
    """Whether something in it is still to be expanded; an expanded file keeps the declaration of the prefix."""
    return any(
        e.tag.startswith("xacro:") or any("${" in v or "$(" in v for v in e.attrib.values()) for e in root.iter()
    )


def _followed(joints: list[UrdfJoint], file: Path) -> list[UrdfJoint]:
    """The joints: one that follows another follower is said to follow the joint at the end of that chain.

    q = f (f2 q2 + o2) + o, so the factor is f f2 and the offset f o2 + o, whatever the order in the file.
    """
    named = {joint.name: joint for joint in joints}
    return [joint if joint.mimic is None else replace(joint, mimic=_end(joint, named, file)) for joint in joints]


def _end(joint: UrdfJoint, named: dict[str, UrdfJoint], file: Path) -> tuple[str, float, float]:
    seen, (to, factor, offset) = [joint.name], joint.mimic or ("", 1.0, 0.0)
    while True:
        if to not in named:
            raise OptionError(f"{file}: joint {joint.name} follows '{to}', which is no joint", nearest(to, named))
        if to in seen:
            raise OptionError(f"{file}: joint {joint.name} follows itself by way of '{to}'", "Correct the URDF")
        seen.append(to)
        if (further := named[to].mimic) is None:
            return to, factor, offset
        to, factor, offset = further[0], factor * further[1], factor * further[2] + offset


def _parsed(content: bytes) -> Element:
    """The root element. Prefixes that nothing declares, such as `drake:`, stay part of a name: readers of ROS do so."""
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(content, True)
    return builder.close()


def read(content: bytes, file: Path, names: Sequence[str], base: str | None = None, tip: str | None = None) -> Urdf:
    """Reads a URDF.

    Args:
        content: of the file.
        file: where it is, for errors and its meshes.
        names: (n) of the elements that move it. They are its joints' names, or stand for the joints from `base` to
            `tip` in their order.
        base: the link whose frame is the robot's own; None: the root.
        tip: the link at the end of the chain; None: all joints that move.
    Raises:
        OptionError: it can't be used.
    """
    found = tree(content, file)
    links, joints, before = found.links, found.joints, found.before
    for what, link in (("base", base), ("tip", tip)):
        if link is not None and link not in links:
            raise OptionError(f"{file} has no link '{link}' for '{what}'", nearest(link, links))
    moved = _moved(joints, before, names, base, tip, file)
    order = found.ordered()
    number = {link: i for i, link in enumerate(order)}
    made = []
    for link in order:
        joint = before.get(link)
        rods = _rods(link, joints)
        if joint is None:
            made.append(Link(link, -1, _above(base, before, file), solids=rods))
            continue
        element, factor, offset = moved.get(joint.name, ("", 1.0, 0.0))
        made.append(Link(link, number[joint.parent], joint.pose, element, joint.axis, joint.kind == "prismatic",
                         factor, offset, rods))  # fmt: skip
    ros2 = [Path(p) / "share" for p in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if p]
    packages = (*(Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(":") if p), *ros2, *file.parents)
    lacking = tuple(text for link in links.values() for text in _lacking(link, file, packages))
    return Urdf(Linkage(tuple(made)), packages, lacking)


def _name(element: Element, file: Path) -> str:
    name = element.get("name")
    if not name:
        raise OptionError(f"{file}: a {element.tag} has no name", "Correct the URDF")
    return name


def numbers(
    text: str | None, count: int, default: tuple[float, ...], place: str, far: float = FAR
) -> tuple[float, ...]:
    """The numbers of an attribute, `default` without one. Raises OptionError: they are none, or beyond `far`."""
    if text is None:
        return default
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(isfinite, values)):
        raise OptionError(f"{place}: '{text}' isn't {count} numbers", _EXPAND)
    if max(map(abs, values)) > far:
        raise OptionError(f"{place}: '{text}' is beyond {far:g}", "Give it in m and rad")
    return values


def _joint(element: Element, file: Path) -> UrdfJoint:
    name, kind = _name(element, file), element.get("type", "")
    place = f"{file}: joint {name}"
    ends = [(e.get("link") if (e := element.find(tag)) is not None else None) for tag in ("parent", "child")]
    if ends[0] is None or ends[1] is None:
        raise OptionError(f"{place} doesn't say which links it joins", "Correct the URDF")
    if kind not in (*_MOVES, "fixed", "floating", "planar"):
        raise OptionError(f"{place}: '{kind}' is no type of joint", "Correct the URDF")
    origin = element.find("origin")
    xyz = numbers(origin.get("xyz") if origin is not None else None, 3, (0.0, 0.0, 0.0), place)
    rpy = numbers(origin.get("rpy") if origin is not None else None, 3, (0.0, 0.0, 0.0), place)
    found = element.find("axis")
    axis = np.array(numbers(found.get("xyz") if found is not None else None, 3, (1.0, 0.0, 0.0), place))
    length = float(np.linalg.norm(axis))
    if kind in _MOVES and length < 1e-9:
        raise OptionError(f"{place}: its axis has no direction", "Correct the URDF")
    x, y, z = (axis / (length or 1.0)).tolist()
    mimic = element.find("mimic")
    follows = None
    if mimic is not None:
        (factor,), (offset,) = (
            numbers(mimic.get(key), 1, (plain,), place) for key, plain in (("multiplier", 1.0), ("offset", 0.0))
        )
        if not mimic.get("joint"):
            raise OptionError(f"{place}: its <mimic> doesn't say which joint it follows", "Correct the URDF")
        follows = (str(mimic.get("joint")), factor, offset)
    pose = (*xyz, *rotation.from_rpy(*rpy))
    limits, friction = _limits(element, place)
    return UrdfJoint(name, kind, ends[0], ends[1], pose, (x, y, z), follows, limits, friction)  # type: ignore[arg-type]


def _limits(element: Element, place: str) -> tuple[dict[str, float], float]:
    limit, dynamics = element.find("limit"), element.find("dynamics")
    given = {key: limit.get(key) for key in ("lower", "upper", "velocity", "effort")} if limit is not None else {}
    found = {
        key: numbers(text, 1, (), f"{place}: limit {key}", inf)[0] for key, text in given.items() if text is not None
    }
    friction = dynamics.get("friction") if dynamics is not None else None
    return found, numbers(friction, 1, (0.0,), f"{place}: friction", inf)[0]


def _tree(joints: list[UrdfJoint], links: dict[str, Element], file: Path) -> dict[str, UrdfJoint]:
    """The joint before each link but the root. Raises OptionError: they are no tree."""
    before: dict[str, UrdfJoint] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise OptionError(f"{file}: joint {joint.name}: there is no link '{link}'", nearest(link, links))
        if joint.child in before:
            raise OptionError(f"{file}: two joints move the link '{joint.child}'", "Correct the URDF")
        before[joint.child] = joint
    roots = [link for link in links if link not in before]
    if len(roots) != 1:
        raise OptionError(f"{file} has {len(roots)} roots ({', '.join(roots[:3])}), not one", "Correct the URDF")
    for link in links:
        _way(link, before, file, len(links))
    return before


def _way(link: str, before: dict[str, UrdfJoint], file: Path, most: int) -> list[UrdfJoint]:
    """The joints from the root to a link."""
    way: list[UrdfJoint] = []
    while link in before:
        way.append(before[link])
        link = before[link].parent
        if len(way) > most:
            raise OptionError(f"{file}: its joints form a circle at '{link}'", "Correct the URDF")
    return way[::-1]


def _above(base: str | None, before: dict[str, UrdfJoint], file: Path) -> Pose:
    """The root's pose in the frame of `base`."""
    pose = IDENTITY
    for joint in _way(base, before, file, MOST) if base is not None else ():
        if joint.kind != "fixed":
            raise OptionError(f"{file}: its root moves in '{base}', by joint {joint.name}", "Name a 'base' before it")
        pose = rotation.composed(pose, joint.pose)
    return rotation.inverted(pose)


def _moved(
    joints: list[UrdfJoint],
    before: dict[str, UrdfJoint],
    names: Sequence[str],
    base: str | None,
    tip: str | None,
    file: Path,
) -> dict[str, tuple[str, float, float]]:
    """By joint: the element that moves it, and how."""
    free = [j for j in joints if j.kind in _MOVES and j.mimic is None]
    if set(names) <= {j.name for j in free} and tip is None:
        moved = {name: (name, 1.0, 0.0) for name in names}
    else:
        if tip is not None:
            above = {j.name for j in _way(base, before, file, MOST)} if base is not None else set()
            free = [j for j in _way(tip, before, file, MOST) if j in free and j.name not in above]
        if len(free) != len(names):
            what = f"{len(free)} joints move{f' up to {tip}' if tip else ''}, and the robot has {len(names)}"
            raise OptionError(f"{file}: {what}", "Name the 'base' and the 'tip' between which the robot's joints are")
        moved = {joint.name: (name, 1.0, 0.0) for joint, name in zip(free, names, strict=True)}
    for joint in joints:
        if joint.mimic is not None and joint.mimic[0] in moved:
            moved[joint.name] = (moved[joint.mimic[0]][0], *joint.mimic[1:])
    return moved


def _ordered(links: dict[str, Element], before: dict[str, UrdfJoint], joints: list[UrdfJoint]) -> list[str]:
    """The links, each after the one that it hangs on."""
    order = [link for link in links if link not in before]
    for link in order:
        order += [j.child for j in joints if j.parent == link]
    return order


def _rods(link: str, joints: list[UrdfJoint]) -> tuple[Solid, ...]:
    """Rods from a link's frame to the joints behind it: its shape where its meshes can't be drawn."""
    made = []
    for joint in (j for j in joints if j.parent == link):
        end = np.array(joint.pose[:3])
        length = float(np.linalg.norm(end))
        if length > 1e-3:
            w, i, j, k = rotation.from_z(end[None])[0].tolist()
            x, y, z = (end / 2).tolist()
            made.append(Solid("capsule", (min(max(0.12 * length, 0.004), 0.05), length / 2), (x, y, z, w, i, j, k)))
        elif joint.kind in _MOVES:
            made.append(Solid("sphere", (0.01,), color=DARK))
    return tuple(made)


def _lacking(link: Element, file: Path, packages: Sequence[Path]) -> list[str]:
    found = []
    for mesh in link.iterfind("visual/geometry/mesh"):
        given = mesh.get("filename", "")
        path = _resolved(given, file, packages)
        what = f"mesh {given[:200]} of link {link.get('name')}"
        if path is None:
            found.append(f"{what} isn't there")
        elif path.suffix.lower() not in FORMATS:
            found.append(f"{what} isn't one of {', '.join(FORMATS)}")
        elif path.stat().st_size > LARGEST:
            found.append(f"{what} has more than {LARGEST >> 20} MiB, which each segment of a recording would hold")
    return found


def _resolved(given: str, file: Path, packages: Sequence[Path]) -> Path | None:
    """The file of a mesh; None: it isn't there, may not be read, or has no name that a file can have."""
    try:
        parts = urlsplit(given)
        if parts.scheme == "package":
            inner = unquote(f"{parts.netloc}{parts.path}")
            return next((folder / inner for folder in packages if (folder / inner).is_file()), None)
        path = file.parent / unquote(parts.path if parts.scheme == "file" else given)
        return path if path.is_file() and os.access(path, os.R_OK) else None
    except (OSError, ValueError):
        return None
