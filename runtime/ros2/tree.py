"""The profile's frames and the robots' links as one tree for tf."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts import rotation
from srl.runtime.contracts.frames import as_pose
from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import time_of
from srl.runtime.recording.robots import Robot
from srl.runtime.recording.shapes import Placing

ROOT: Final = "root"  # where nothing else has a name for it


@dataclass(frozen=True)
class Edge:
    """A frame in its parent.

    Attributes:
        parent, child: their names.
        pose: of the child in the parent; of one that moves, where it is at zero.
        robot, number: the link that is the child; None of a frame of the profile.
        signal: that measures the child in `pose`; "" for none.
    """

    parent: str
    child: str
    pose: Pose
    robot: Robot | None = None
    number: int = -1
    signal: str = ""

    @property
    def moves(self) -> bool:
        """Whether it moves."""
        return bool(self.signal) or (self.robot is not None and self.number in self.robot.linkage.moving)


class Tree:
    """The edges. Each child is there once; `roots` have no parent.

    Attributes:
        root: the frame in which what has no frame is: the profile's first that is fixed and has no parent, else the
            only robot's, else ROOT.
    """

    def __init__(self, layout: Layout, robots: list[Robot]) -> None:
        self._layout = layout
        found: dict[str, Edge] = {}
        for robot in robots:
            for number, link in enumerate(robot.linkage.links):
                up = frame_of(robot, link.parent) if link.parent >= 0 else robot.on or robot.name
                child = frame_of(robot, number)
                found.setdefault(child, Edge(up, child, link.pose, robot, number))
        frames = Placing(layout).frames
        fixed = [name for name, entry in frames.items() if entry.parent is None and entry.pose not in layout.fields]
        standing = {edge.parent for edge in found.values()} - found.keys() if not frames else set()
        self.root = fixed[0] if fixed else standing.pop() if len(standing) == 1 else ROOT
        for name, entry in frames.items():
            signal = entry.pose if entry.pose in layout.fields else None
            if entry.parent is not None or signal is not None:
                found.setdefault(name, Edge(entry.parent or self.root, name, entry.placed(), signal=signal or ""))
        self.edges = tuple(found.values())
        self._moving = [edge for edge in self.edges if edge.moves]
        parents = dict.fromkeys(edge.parent for edge in self.edges)
        self.roots = tuple(name for name in parents if name not in found)

    def static(self, stamp: int) -> cdr.Message:
        """What doesn't move, as tf2_msgs/msg/TFMessage. `stamp`: Unix ns."""
        return {"transforms": [_stamped(e, e.pose, stamp) for e in self.edges if not e.moves]}

    def moving(self, row: NDArray[np.int64], wall: int, links: bool | None = None) -> cdr.Message:
        """What moves, in a row (width,), as tf2_msgs/msg/TFMessage; what isn't known isn't in it.

        `links`: the robots' links alone, or the profile's frames alone; None: both.
        """
        edges = [e for e in self._moving if links is None or links is not bool(e.signal)]
        found = self._moved(edges, row)
        return {"transforms": [_stamped(e, pose, stamp + wall) for e, pose, stamp in found if stamp >= 0]}

    def _moved(self, edges: list[Edge], row: NDArray[np.int64]) -> Iterator[tuple[Edge, Pose, int]]:
        of: dict[str, Array] = {}
        for edge in edges:
            if edge.signal:
                # A law's output stands still while the laws don't run: then the frame isn't known.
                if self._layout.fields[edge.signal].role != "state" and row[CYCLE.state] != State.ACTIVE:
                    continue
                measured = as_pose(self._layout.value(row, edge.signal))
                pose, signal = rotation.composed(edge.pose, measured), edge.signal
            else:
                robot = edge.robot
                assert robot is not None
                if robot.name not in of:
                    of[robot.name] = robot.moved(self._layout, row[None])[0]
                found = of[robot.name][robot.linkage.moving.index(edge.number)]
                pose, signal = tuple(found.tolist()), robot.angles
            if np.isfinite(pose).all():
                yield edge, pose, int(row[self._layout.stamped_by(self._layout.fields[signal])])


def frame_of(robot: Robot, number: int) -> str:
    """The frame of a robot's link, as a profile names it: "arm/flange"."""
    return f"{robot.name}/{robot.linkage.links[number].name}"


def _stamped(edge: Edge, pose: Pose, stamp: int) -> cdr.Message:
    x, y, z, qw, qx, qy, qz = pose
    return {
        "header": {"stamp": time_of(stamp), "frame_id": edge.parent},
        "child_frame_id": edge.child,
        "transform": {"translation": {"x": x, "y": y, "z": z}, "rotation": {"x": qx, "y": qy, "z": qz, "w": qw}},
    }
