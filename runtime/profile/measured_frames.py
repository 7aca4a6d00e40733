"""What the tree of frames says of devices and of signals that measure frames, and the poses that laws rely on."""

from __future__ import annotations

from collections.abc import Container

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.frames import FASTEST, IDENTITY, FrameEntry
from srl.runtime.contracts.terms import PLANAR, POSE
from srl.runtime.ipc.row import Row
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.graph import Law, MonitoredPose


def _measuring(laws: list[Law]) -> set[str]:
    """The signals that measure a frame which a law uses."""
    return {name for law in laws for found in law.transforms for name in found.signals}


def relied_on(laws: list[Law]) -> set[str]:
    """The signals that laws rely on: their inputs, and what measures the frames that they use."""
    return _measuring(laws) | {name for law in laws for wire in law.inputs.values() for name in wire.far}


def monitored_poses(b: Builder, laws: list[Law], names: list[str], row: Row) -> list[MonitoredPose]:
    """The poses of devices and clients that a law relies on: as an input, or as those of a frame."""
    measuring = _measuring(laws)
    poses = sorted(n for n in relied_on(laws) if b.signals[n].labels in (POSE, PLANAR))
    speeds = {entry.pose: entry.speed for entry in b.profile.frames.values()}
    found = []
    for name in poses:
        owner = name.partition(".")[0]
        client = owner not in b.profile.devices
        # A law's own pose is nobody's loss; one that a client sends for a law is a goal, which may be anywhere.
        if owner not in names or (client and name not in measuring):
            continue
        found.append(MonitoredPose(names.index(owner), row.views[name], speeds.get(name, FASTEST), client))
    return found


def check_links(b: Builder, devices: list[Driver]) -> None:
    """Refuses a frame on a link that its device doesn't have."""
    links = {d.name: d.links for d in devices if d.here}
    own = {d.name: bool(d.links) or any(s.of == d.name for s in d.states) for d in devices if d.here}
    for name, frame in b.profile.frames.items():
        device, _, link = (frame.parent or "").partition("/")
        place = b.source.place(f"frames.{name}.parent")
        if link and device in links and link not in links[device] and (links[device] or device not in b.parts):
            known = ", ".join(f"{device}/{each}" for each in links[device]) or "none"
            raise WiringError(place, f"the driver of '{device}' knows no link '{link}'", f"Its links: {known}")
        if not link and device in own and device not in b.profile.frames and not own[device]:
            problem = f"'{device}' is a device that has no frame of its own"
            raise WiringError(place, problem, f"Give it one: {device}: {{parent: ..., position: ...}}")


def check_signals(b: Builder, of: Container[str] | None = None) -> None:
    """Checks the signals that measure frames: those of these devices; None: all."""
    poses = {n: s for n, s in b.signals.items() if s.labels in (POSE, PLANAR) and not n.startswith("world.")}
    for name, frame in b.profile.frames.items():
        if frame.pose is None:
            _at_rest(b, name, frame)
            continue
        if frame.pose.startswith("world."):
            problem = f"'{frame.pose}' is the simulation's truth, which no real device could give"
            raise WiringError(b.source.place(f"frames.{name}.pose"), problem, "Name the state of a device")
        if not (of is None or frame.pose.partition(".")[0] in of):
            continue
        place = b.source.place(f"frames.{name}.pose")
        if frame.pose not in poses:
            problem = f"'{frame.pose}' is no pose signal ({', '.join(POSE)}, or {', '.join(PLANAR)})"
            raise WiringError(place, problem, nearest(frame.pose, poses))
        signal = poses[frame.pose]
        owner = frame.pose.partition(".")[0]
        clients = {each.partition(".")[0] for each in b.profile.setpoints}
        if "speed" in frame.model_fields_set and owner not in {*b.profile.devices, *clients}:
            problem = f"'{frame.pose}' is a law's, which itself says when it is lost: nobody would watch its speed"
            raise WiringError(b.source.place(f"frames.{name}.speed"), problem, "Remove it")
        if signal.frame is not None and signal.frame != frame.parent:
            problem = f"'{frame.pose}' is given in '{signal.frame}', and the frame's parent is '{frame.parent}'"
            raise WiringError(place, problem, f"Write `parent: {signal.frame}`")
        if signal.frame is not None and frame.placed() != IDENTITY:
            problem = (
                f"'{frame.pose}' is given in '{frame.parent}' already, and the frame's own place would count again"
            )
            remedy = (
                f"Leave it out; or give what measures a frame of its own, say `odom: {{parent: {frame.parent}, ...}}`"
            )
            raise WiringError(place, problem, remedy)
        if signal.of is not None and signal.of != name:
            raise WiringError(place, f"'{frame.pose}' is the pose of '{signal.of}'", "Name a signal of this frame")


def _at_rest(b: Builder, name: str, frame: FrameEntry) -> None:
    """Refuses a fixed place for the frame of a device that says where it goes, and a speed of what is fixed."""
    if "speed" in frame.model_fields_set:
        place = b.source.place(f"frames.{name}.speed")
        raise WiringError(place, f"'{name}' is fixed, and moves at no speed", "Remove it, or add `pose:`")
    signal = next((n for n, s in b.signals.items() if s.of == name and n.startswith(f"{name}.") and s.labels), None)
    if (
        name in b.profile.devices
        and frame.parent is not None
        and signal is not None
        and b.signals[signal].labels in (POSE, PLANAR)
    ):
        problem = f"'{name}' moves, and '{signal}' says where it is; fixed, it would stay where it began"
        raise WiringError(b.source.place(f"frames.{name}"), problem, f"Write `pose: {signal}`")
