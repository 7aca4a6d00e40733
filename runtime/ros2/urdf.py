"""The robots of a run as one URDF, whose links are the frames of tf."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from math import atan2, hypot, isfinite
from pathlib import Path
from typing import Any, Final

from srl.runtime.contracts import rotation
from srl.runtime.contracts.linkage import Solid
from srl.runtime.contracts.rotation import Pose
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.robots import Robot
from srl.runtime.ros2.joints import Joints
from srl.runtime.ros2.tree import Edge, Tree

ROOT: Final = "srl_root"  # the link that several trees hang on; tf doesn't have it
FAR: Final = 1e3  # m, m/s, N, N m: where nobody has given a limit


def description(name: str, layout: Layout, tree: Tree, joints: Joints, meshes: bool = True) -> str:
    """The URDF.

    Args:
        name: of the robot.
        layout: of the rows, with the guard's limits of each command.
        tree, joints: links and joints, by their names in ROS.
        meshes: whether a link has the visual elements of its own file; else it has plain shapes, which need no file.
    """
    limits = {
        command: {**found, "labels": layout.fields[command].labels}
        for command, found in layout.meta.get("limits", {}).items()
        if command in layout.fields
    }
    robot = ET.Element("robot", name=name)
    own = {edge.child: edge for edge in tree.edges}
    visuals, materials = _files(edge.robot for edge in tree.edges if edge.robot is not None and meshes)
    robot.extend(materials)
    if len(tree.roots) > 1:
        ET.SubElement(robot, "link", name=ROOT)
    for link in (*tree.roots, *own):
        made = ET.SubElement(robot, "link", name=link)
        edge = own.get(link)
        if edge is None or edge.robot is None:
            continue
        body = edge.robot.linkage.links[edge.number]
        drawn = visuals.get((edge.robot.name, body.name), ())
        made.extend(drawn)
        for solid in () if drawn else body.solids:
            _visual(made, solid)
    for root in tree.roots if len(tree.roots) > 1 else ():
        _joint(robot, f"{root}_joint", "fixed", ROOT, root, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    for edge in tree.edges:
        _edge(robot, edge, joints, limits)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _edge(parent: ET.Element, edge: Edge, joints: Joints, limits: Mapping[str, Mapping[str, Any]]) -> None:
    if edge.robot is None or not edge.moves:
        kind = "floating" if edge.moves else "fixed"
        _joint(parent, f"{edge.child}_joint", kind, edge.parent, edge.child, edge.pose)
        return
    link = edge.robot.linkage.links[edge.number]
    bounds, effort = _bounds(edge.robot, edge.number, limits), _effort(edge.robot, edge.number, limits)
    kind = "prismatic" if link.slides else "revolute"
    if bounds is None and not link.slides:
        kind = "continuous"
    made = _joint(parent, joints.name_of(edge.robot, edge.number), kind, edge.parent, edge.child, edge.pose)
    ET.SubElement(made, "axis", xyz=_text(link.axis))
    leader = joints.leader_of(edge.robot, edge.number)
    if leader and leader != made.get("name"):
        ET.SubElement(made, "mimic", joint=leader, multiplier=f"{link.factor:.9g}", offset=f"{link.offset:.9g}")
    if bounds is not None:
        lower, upper, velocity = bounds
        _limit(made, lower, upper, velocity, effort)
    elif link.slides:  # a slide must have limits in a URDF: so far that they say nothing
        _limit(made, -FAR, FAR, FAR, effort)


def _bounds(robot: Robot, number: int, limits: Mapping[str, Mapping[str, Any]]) -> tuple[float, float, float] | None:
    """lower, upper and velocity that the guard allows the joint; None where it has no position limits."""
    link, device = robot.linkage.links[number], robot.angles.partition(".")[0]
    for name, found in limits.items():
        if name.partition(".")[0] != device or found.get("lower") is None or found.get("upper") is None:
            continue
        labels: Sequence[str] = found["labels"]
        if link.joint not in labels:
            return None
        i = labels.index(link.joint)
        ends = sorted(link.factor * float(found[end][i]) + link.offset for end in ("lower", "upper"))
        velocity = found.get("velocity")
        fastest = FAR if velocity is None else min(abs(link.factor) * float(velocity[i]), FAR)
        return (ends[0], ends[1], fastest) if isfinite(ends[0] + ends[1]) else None
    return None


def _effort(robot: Robot, number: int, limits: Mapping[str, Mapping[str, Any]]) -> float:
    """N m or N, that the guard allows the joint; FAR where it has no such limit."""
    joint, device = robot.linkage.links[number].joint, robot.angles.partition(".")[0]
    for name, found in limits.items():
        if name.partition(".")[0] == device and found.get("effort") is not None and joint in found["labels"]:
            most = float(found["effort"][found["labels"].index(joint)])
            return most if isfinite(most) else FAR
    return FAR


def _limit(joint: ET.Element, lower: float, upper: float, velocity: float, effort: float) -> None:
    numbers = {"lower": lower, "upper": upper, "velocity": velocity, "effort": effort}
    ET.SubElement(joint, "limit", {name: f"{number:g}" for name, number in numbers.items()})


def _files(robots: Iterable[Robot]) -> tuple[dict[tuple[str, str], list[ET.Element]], list[ET.Element]]:
    """The visual elements of the profile's own URDFs, by robot and link, and the materials that they name.

    A mesh beside the file gets its whole path. A file that can't be read has none.
    """
    found: dict[tuple[str, str], list[ET.Element]] = {}
    materials: dict[str, ET.Element] = {}
    for robot in {robot.name: robot for robot in robots if robot.file}.values():
        try:
            root = ET.parse(robot.file).getroot()
        except (OSError, ET.ParseError):
            continue
        for mesh in root.iter("mesh"):
            name = mesh.get("filename", "")
            if name and ":" not in name:
                mesh.set("filename", (Path(robot.file).resolve().parent / name).as_uri())
        for material in root.findall("material"):
            materials.setdefault(material.get("name", ""), material)
        for link in root.findall("link"):
            found[robot.name, link.get("name", "")] = link.findall("visual")
    return found, list(materials.values())


def _joint(parent: ET.Element, name: str, kind: str, up: str, child: str, pose: Pose) -> ET.Element:
    made = ET.SubElement(parent, "joint", name=name, type=kind)
    ET.SubElement(made, "parent", link=up)
    ET.SubElement(made, "child", link=child)
    _origin(made, pose)
    return made


def _visual(link: ET.Element, solid: Solid) -> None:
    """A solid; of a capsule, a cylinder between two balls."""
    if solid.kind == "capsule":
        radius, half = solid.size
        _shape(link, solid, solid.pose, "cylinder", radius=radius, length=2 * half)
        for end in (-half, half):
            middle = rotation.composed(solid.pose, (0.0, 0.0, end, 1.0, 0.0, 0.0, 0.0))
            _shape(link, solid, middle, "sphere", radius=radius)
    elif solid.kind == "box":
        visual = _shape(link, solid, solid.pose, "box")
        visual.set("size", _text(2 * size for size in solid.size))
    elif solid.kind == "cylinder":
        _shape(link, solid, solid.pose, "cylinder", radius=solid.size[0], length=2 * solid.size[1])
    else:
        _shape(link, solid, solid.pose, "sphere", radius=solid.size[0])


def _shape(link: ET.Element, solid: Solid, pose: Pose, kind: str, **sizes: float) -> ET.Element:
    visual = ET.SubElement(link, "visual")
    _origin(visual, pose)
    shape = ET.SubElement(ET.SubElement(visual, "geometry"), kind, {k: f"{v:g}" for k, v in sizes.items()})
    material = ET.SubElement(visual, "material", name="rgb_" + "_".join(map(str, solid.color)))
    ET.SubElement(material, "color", rgba=_text((*(c / 255 for c in solid.color), 1.0)))
    return shape


def _origin(parent: ET.Element, pose: Pose) -> None:
    R = rotation.matrix(rotation.normalised((pose[3], pose[4], pose[5], pose[6])))
    flat = hypot(R[0, 0], R[1, 0])
    pitch = atan2(-R[2, 0], flat)
    if flat > 1e-8:
        roll, yaw = atan2(R[2, 1], R[2, 2]), atan2(R[1, 0], R[0, 0])
    else:  # x points up or down: only the sum or the difference of the others counts
        roll, yaw = 0.0, atan2(-R[0, 1], R[1, 1])
    ET.SubElement(parent, "origin", xyz=_text(pose[:3]), rpy=_text((roll, pitch, yaw)))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
