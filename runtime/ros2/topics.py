"""A run's topics and their messages for programs that show it: of a recording in MCAP, and live for Foxglove.

Signals are named as on the bus: `/finger/position_command`. A topic's metadata has the signal's name, unit, labels and
components, as the bus's metadata has them. `/tf_static` and `/tf` hold the frames and links, `/joint_states` and
`/robot_description` the robot, `/scene` and `/scenery` what else the pictures draw, `/rosout` the events, `/loop/cycle`
and `/loop/devices/NAME` the header fields, whose names are in the topic's metadata.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.field import Field
from srl.runtime.ipc.events import Event, Level
from srl.runtime.ipc.header import CYCLE, DEVICE
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import JOINT_STATE, STRING, Encoder, describe, time_of
from srl.runtime.profile.keys import path
from srl.runtime.recording.robots import robots
from srl.runtime.ros2.joints import Joints, moved_by_devices
from srl.runtime.ros2.names import TF
from srl.runtime.ros2.scene import MARKERS, Scene, scenery
from srl.runtime.ros2.tree import Tree
from srl.runtime.ros2.urdf import description

WORDS: Final = "std_msgs/msg/Int64MultiArray"
LOG: Final = "rcl_interfaces/msg/Log"
LEVELS: Final = {Level.INFO: 20, Level.WARNING: 30, Level.ERROR: 40}  # of LOG
LATCHED: Final = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, deadline: {sec: 0, nsec: 0}, lifespan: {sec: 0, nsec: 0}, "
    "liveliness: 1, liveliness_lease_duration: {sec: 0, nsec: 0}, avoid_ros_namespace_conventions: false}"
)  # ROS 2's quality of service of a topic whose last message is kept for those that come later

Payloads = NDArray[np.uint8]


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: with its slash.
        kind: of its messages.
        about: its metadata.
        kept: the payload of its only message; None where there are more.
        encode: makes the payloads (k, bytes) of rows (k, width) with their stamps (k,), Unix ns; None where a row
            doesn't give one of each.
    """

    name: str
    kind: str
    about: dict[str, str]
    kept: bytes | None = None
    encode: Callable[[Words, Words], Payloads] | None = None


class Topics:
    """The topics of one layout.

    Attributes:
        all: every topic.
        tree: of the frames and links.
    """

    def __init__(self, layout: Layout, first: int) -> None:
        """`first`: Unix ns, the stamp of what never changes. Raises RecordingError: two signals have one name."""
        self._layout, self._wall = layout, int(layout.meta.get("wall", 0))
        found = moved_by_devices(robots(layout), layout)
        self.tree, self._joints = Tree(layout, found), Joints(layout, found)
        self._scene = Scene(layout, self.tree.root)
        moves = {bool(edge.signal) for edge in self.tree.edges if edge.moves}
        self._frames, self._links = True in moves, False in moves
        self._tf, self._log = Topic("/tf", TF, {}), Topic("/rosout", LOG, {})
        self._states, self._drawn = Topic("/joint_states", JOINT_STATE, {}), Topic("/scene", MARKERS, {})
        name = str(layout.meta.get("name", "robot"))
        static, fixed = self.tree.static(first), scenery(layout, self.tree.root, first)
        kept: list[tuple[bool, str, str, cdr.Message]] = [
            (bool(static["transforms"]), "/tf_static", TF, static),
            (len(fixed["markers"]) > 1, "/scenery", MARKERS, fixed),
        ]
        if found:
            text = description(name, layout, self.tree, self._joints, meshes=False)
            kept.append((True, "/robot_description", STRING, {"data": text}))
        there = (bool(moves), bool(self._joints.names), self._scene.there, True)
        moving = (self._tf, self._states, self._drawn, self._log)
        self.all = [
            *(
                Topic(n, k, {"offered_qos_profiles": LATCHED}, cdr.encode(k, m))
                for is_there, n, k, m in kept
                if is_there
            ),
            *(topic for topic, is_there in zip(moving, there, strict=True) if is_there),
            *self._words(),
            *self._signals(),
        ]

    def moving(
        self, row: Words, stamp: int, frames: bool = True, links: bool = True, scene: bool = True
    ) -> Iterator[tuple[Topic, bytes]]:
        """The messages of a row (width,) that aren't one a row.

        Args:
            row: of the layout.
            stamp: its own, Unix ns.
            frames: whether the frames that signals measure are asked for.
            links: whether the robots' links and joints are.
            scene: whether the markers are.
        """
        transforms = self.tree.moving(row, self._wall, links=False)["transforms"] if frames and self._frames else []
        if links and self._links:
            transforms += self.tree.moving(row, self._wall, links=True)["transforms"]
        if transforms:
            yield self._tf, cdr.encode(TF, {"transforms": transforms})
        if links and self._joints.names and (made := self._joints.message(row, self._wall)) is not None:
            yield self._states, cdr.encode(JOINT_STATE, made[1])
        if scene and self._scene.there:
            yield self._drawn, cdr.encode(MARKERS, self._scene.message(row, stamp))

    def event(self, event: Event, stamp: int) -> tuple[Topic, bytes]:
        """An event's message. `stamp`: Unix ns."""
        message = {
            "stamp": time_of(stamp), "level": LEVELS[event.level], "name": "srl", "msg": event.text, "file": "",
            "function": f"cycle {event.cycle}", "line": 0,
        }  # fmt: skip
        return self._log, cdr.encode(LOG, message)

    def _words(self) -> Iterator[Topic]:
        """The int64 words: those of the cycle, and of each device."""
        layout = self._layout
        groups: list[tuple[str, slice, tuple[str, ...]]] = [("/loop/cycle", slice(0, len(CYCLE)), CYCLE._fields)]
        groups += [(f"/loop/devices/{path(d)}", layout.device(i), DEVICE._fields) for i, d in enumerate(layout.devices)]
        for name, place, names in groups:
            dim = [{"label": "words", "size": len(names), "stride": len(names)}]
            message = {"layout": {"dim": dim, "data_offset": 0}, "data": np.zeros(len(names), np.int64)}
            head = np.frombuffer(cdr.encode(WORDS, message)[: -8 * len(names)], np.uint8)

            def make(rows: Words, _: Words, place: slice = place, head: Payloads = head) -> Payloads:
                words = np.ascontiguousarray(rows[:, place], "<i8").view(np.uint8)
                return np.hstack([np.tile(head, (len(rows), 1)), words])

            yield Topic(name, WORDS, {"labels": json.dumps(names)}, encode=make)

    def _signals(self) -> Iterator[Topic]:
        """The signals, with the bus's messages. A header has the time of the device's sample."""
        names: dict[str, str] = {}
        for field in self._layout.fields.values():
            name = topic_of(field)
            other = names.setdefault(name, field.name)
            if other != field.name:
                problem = f"'{field.name}' and '{other}' would have the same topic {name}"
                raise RecordingError(self._layout.meta.get("name", "topics"), problem, "Rename one in the profile")
            encoder, column = Encoder(field), self._layout.stamped_by(field)

            def make(
                rows: Words, stamps: Words, name: str = field.name, encoder: Encoder = encoder, column: int = column
            ) -> Payloads:
                taken = rows[:, column]
                return encoder.encode_all(
                    self._layout.value(rows, name), np.where(taken < 0, stamps, taken + self._wall)
                )

            about = {k: _text(v) for k, v in describe(field).items() if k != "type" and v is not None}
            yield Topic(name, encoder.kind, about, encode=make)


def topic_of(field: Field) -> str:
    """A signal's topic."""
    return f"/{path(field.name)}"


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
