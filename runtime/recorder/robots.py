"""Robots in the recording's 3D view: fixed shapes or meshes at each link, and one entity that moves all links.

Every link has a frame; its shapes hang on it and are sent once. What moves are the frames, as rows of `/tf`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.urdf import UrdfTree

from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.recorder.solid_shapes import solid_shapes
from srl.runtime.recording.robots import Robot, robots

TF: Final = "/tf"
ROOT: Final = "tf#/"  # rerun's own name of the frame of "/"


class Moves:
    """Rows of `/tf`: the poses of frames in other frames."""

    def __init__(self) -> None:
        self._at: list[NDArray[np.int64]] = []
        self._poses: list[Array] = []
        self._parents: list[str] = []
        self._children: list[str] = []

    def add(self, poses: Array, parent: str, child: str) -> None:
        """Adds one frame's poses (k, 7), one a row; those that aren't finite are left out."""
        at = np.flatnonzero(np.isfinite(poses).all(axis=1))
        self._at.append(at)
        self._poses.append(poses[at])
        self._parents += [parent] * len(at)
        self._children += [child] * len(at)

    def send(self, rows: NDArray[np.int64], send: Callable[..., None]) -> None:
        """Sends all that was added as one set of columns; `rows` (k, width) have their times."""
        if not self._children:
            return
        p = np.concatenate(self._poses)
        columns = rr.Transform3D.columns(
            translation=p[:, :3], quaternion=p[:, [4, 5, 6, 3]], parent_frame=self._parents, child_frame=self._children
        )
        send(TF, rows[np.concatenate(self._at)], columns)


class RobotShapes:
    """The robots of one layout.

    Attributes:
        robots: all of them.
        problems: what couldn't be drawn as it was asked for, a line each; known after `statics`.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self.robots = robots(layout)
        self.problems: list[str] = []

    def statics(self, recording: rr.RecordingStream, frames: Any) -> None:
        """Sends what doesn't move; `frames` are the names of those that the recording has."""
        for robot in self.robots:
            for number, link in enumerate(robot.linkage.links):
                above = robot.on.replace("/", ":") if robot.on else robot.name if robot.name in frames else ROOT
                if not link.joint:
                    T = homogeneous(link.pose)
                    parent = robot.frame(link.parent) if link.parent >= 0 else above
                    fixed = rr.Transform3D(
                        translation=T[:3, 3], mat3x3=T[:3, :3], parent_frame=parent, child_frame=robot.frame(number)
                    )
                    path = rr.new_entity_path(["frames", robot.frame(number)])
                    rr.log(path, fixed, static=True, recording=recording, strict=True)
            if robot.file and self._meshes(robot, recording):
                continue
            for number, link in enumerate(robot.linkage.links):
                for kind, shape in solid_shapes(link.solids):
                    path = rr.new_entity_path([robot.entity, link.name, kind])
                    frame = rr.CoordinateFrame(robot.frame(number))
                    rr.log(path, frame, shape, static=True, recording=recording, strict=True)

    def _meshes(self, robot: Robot, recording: rr.RecordingStream) -> bool:
        """Sends the meshes of a robot's URDF; returns whether that went well."""
        before = os.environ.get("ROS_PACKAGE_PATH")
        os.environ["ROS_PACKAGE_PATH"] = ":".join(robot.packages)  # rerun looks for `package://` there
        try:
            tree = UrdfTree.from_file_path(robot.file, robot.entity, frame_prefix=f"{robot.name}:")
            names = {link.name for link in robot.linkage.links}
            paths = {path for name in names for path in tree.get_visual_geometry_paths(name)}
            chunks = [c for c in tree.stream(include_joint_transforms=False) if c.entity_path in paths]
        except Exception as error:  # rerun says neither which it raises nor that it raises
            self.problems.append(f"{robot.name}: {robot.file} isn't drawn ({error}); it has plain shapes")
            return False
        finally:
            if before is None:
                del os.environ["ROS_PACKAGE_PATH"]
            else:
                os.environ["ROS_PACKAGE_PATH"] = before
        recording.send_chunks(chunks)
        return True

    def move(self, moves: Moves, rows: NDArray[np.int64]) -> None:
        """Adds where the links are in rows (k, width)."""
        for robot in self.robots:
            poses = robot.moved(self._layout, rows)
            for place, number in enumerate(robot.linkage.moving):
                parent = robot.frame(robot.linkage.links[number].parent)
                moves.add(poses[:, place], parent, robot.frame(number))
