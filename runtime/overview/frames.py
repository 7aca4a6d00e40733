"""The tree of frames of a wired system, with what hangs on each: for `srl check --all`.

The runtime knows a link that moves with joints (`arm/flange`), or a body of a simulated part, as a root: no fixed
number says where it is. Here each stands below what it moves with, without a place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Any

from srl.runtime.contracts.frames import IDENTITY, Placement
from srl.runtime.contracts.rotation import Pose, composed, euler, homogeneous
from srl.runtime.profile.graph import Graph

Item = dict[str, Any]
_SHOWN = ("state", "setpoint", "internal", "command")
"""The roles of signals; the others are companions of a command, or the simulation's truth."""


def models(graph: Graph) -> list[Item]:
    """The profile's models: name, kind, and the options that it gives."""
    found = []
    for name, entry in graph.profile.models.items():
        options = entry.model_dump(mode="json", exclude_unset=True)
        found.append({"name": name, "kind": entry.kind, "options": {k: v for k, v in options.items() if k != "kind"}})
    return found


def frames(graph: Graph) -> list[Item]:
    """The frames, each after its parent and its parent's earlier children, in the profile's order.

    Of each: `name`; `kind` (root, fixed, measured, device, link, body); `parent` and `depth` in this tree; as the
    profile gives them `position` (m) and `quaternion` (w x y z) or `rpy` (rad); `pose` in the parent (x y z qw qx qy
    qz; None: nobody knows it) and `turned` (roll, pitch, yaw, rad); `root` and `pose_in_root`, with what is measured
    taken as zero; `measured_by` and `fastest` (m/s); and what hangs on it: `devices`, `parts` of the simulated world,
    signals `in` it and `of` it, laws that use it (`used_by`).
    """
    found = parts(graph)
    names = _names(graph, found)
    parents = {name: _parent(graph, name, names, found) for name in names}
    return [_item(graph, name, depth, parents[name], found) for name, depth in _walk(parents, None, 0)]


def _walk(parents: Mapping[str, str | None], above: str | None, depth: int) -> Iterator[tuple[str, int]]:
    for name, parent in parents.items():
        if parent == above:
            yield name, depth
            yield from _walk(parents, name, depth + 1)


def _names(graph: Graph, standing: Mapping[str, Item]) -> list[str]:
    """The profile's frames, and those that they, the parts and the signals name and no entry has."""
    named = list(graph.frames.entries)
    named += [entry.parent for entry in graph.frames.entries.values() if entry.parent is not None]
    named += [part["at"] for part in standing.values() if part["at"] is not None]
    named += list(_signals(graph))
    named += [name for law in graph.laws for t in law.transforms for name in (t.path.target, t.path.source)]
    return list(dict.fromkeys(named))


def _parent(graph: Graph, name: str, names: list[str], standing: Mapping[str, Item]) -> str | None:
    entry = graph.frames.entries.get(name)
    if entry is not None:
        return entry.parent
    owner, slash, _ = name.partition("/")
    if not slash:
        return None
    if owner in names:
        return owner
    stands = standing[owner]["at"] if owner in standing else None
    return stands if stands in names and not _below(stands, name, standing) else None


def _below(frame: str, body: str, standing: Mapping[str, Item]) -> bool:
    """Whether a part that stands at `frame` stands, by way of others, on this body's own part."""
    seen = set()
    while frame not in seen:
        seen.add(frame)
        owner = frame.partition("/")[0]
        if owner == body.partition("/")[0]:
            return True
        frame = (standing[owner]["at"] if owner in standing else None) or frame
    return False


def _item(graph: Graph, name: str, depth: int, parent: str | None, standing: Mapping[str, Item]) -> Item:
    entry = graph.frames.entries.get(name)
    root = graph.frames.chain(name)[-1]
    fixed = graph.frames.fixed(graph.frames.path(root, name)) if graph.frames.has(name) else IDENTITY
    placed = entry.placed() if entry is not None and entry.parent is not None else None
    signals = _signals(graph)
    return {
        "name": name,
        "kind": _kind(graph, name),
        "parent": parent,
        "depth": depth,
        "position": list(entry.position) if entry is not None and placed is not None else None,
        "quaternion": list(entry.quaternion) if entry is not None and entry.quaternion is not None else None,
        "rpy": list(entry.rpy) if entry is not None and entry.rpy is not None else None,
        "pose": list(placed) if placed is not None else None,
        "turned": turned(placed) if placed is not None else None,
        "root": root,
        "pose_in_root": list(fixed),
        "measured_by": entry.pose if entry is not None else None,
        "fastest": _fastest(graph, entry.pose) if entry is not None and entry.pose is not None else None,
        "devices": [device.name for device in graph.devices if device.name == name],
        "parts": [{**part, "name": own} for own, part in standing.items() if part["at"] == name],
        "in": signals.get(name, {}).get("in", []),
        "of": signals.get(name, {}).get("of", []),
        "used_by": [
            f"{law.controller.name}.{found.need.name}"
            for law in graph.laws
            for found in law.transforms
            if name in (found.path.target, found.path.source, *found.path.up, *found.path.down)
        ],
    }


def _fastest(graph: Graph, signal: str) -> float | None:
    """m/s that the runtime believes of a measured frame; None: it isn't watched, or it may jump."""
    speeds = [monitored.speed for monitored in graph.monitored_poses if monitored.pose is graph.row.views[signal]]
    return next((speed for speed in speeds if isfinite(speed)), None)


def _kind(graph: Graph, name: str) -> str:
    entry = graph.frames.entries.get(name)
    if entry is not None:
        return "measured" if entry.pose is not None else "root" if entry.parent is None else "fixed"
    owner, slash, link = name.partition("/")
    if slash:
        device = next((device for device in graph.devices if device.name == owner), None)
        # What isn't here (a recording in the place of an arm) doesn't know its links.
        return "link" if device is not None and (link in device.links or not device.here) else "body"
    return "device" if owner in graph.profile.devices else "root"


def _signals(graph: Graph) -> dict[str, dict[str, list[str]]]:
    """By frame: the signals given `in` it, and those that are the pose, twist or wrench `of` it."""
    found: dict[str, dict[str, list[str]]] = {}
    for field in graph.layout.fields.values():
        if field.frame is not None and field.role in _SHOWN:
            found.setdefault(field.frame, {"in": [], "of": []})["in"].append(field.name)
    of = {f"{device.name}.{s.name}": s.of for device in graph.devices for s in device.states}
    of |= {wire.far[0]: wire.near.of for law in graph.laws for wire in law.outputs.values()}
    for name, frame in of.items():
        if frame is not None:
            found.setdefault(frame, {"in": [], "of": []})["of"].append(name)
    return found


def parts(graph: Graph) -> dict[str, Item]:
    """The simulated world's parts by name: `part` (its kind), `at` (a frame; None: the world's origin) and `pose`."""
    given = graph.profile.sim.options.get("parts") if graph.world is not None and graph.profile.sim else None
    found: dict[str, Item] = {}
    for name, options in given.items() if isinstance(given, Mapping) else ():
        at, pose = options.get("at"), IDENTITY
        if isinstance(at, Mapping):
            pose = Placement.model_validate({k: v for k, v in at.items() if k != "parent"}).placed()
            at = at.get("parent")
        if at is None and name in graph.frames.entries and not isinstance(options.get("at"), Mapping):
            at = name
        if "off_by" in options:
            pose = composed(pose, Placement.model_validate(options["off_by"]).placed())
        found[name] = {"part": str(options.get("part")), "at": at, "pose": list(pose)}
    return found


def turned(pose: Pose) -> list[float]:
    """Roll, pitch and yaw of a pose, rad, about the fixed axes x, then y, then z."""
    yaw, pitch, roll = euler(homogeneous(pose)[:3, :3], "ZYX")
    return [roll, pitch, yaw]
