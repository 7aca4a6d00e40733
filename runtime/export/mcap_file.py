"""A recording as MCAP with ROS 2's messages: a topic for each signal, the robot's joints, frames, links and URDF.

Topics are named as on the bus: `/finger/position_command`. A channel's metadata has the signal's name, unit, labels and
components, as the bus's metadata has them. `/tf_static` and `/tf` hold the frames and links, `/joint_states` and
`/robot_description` the robot, `/rosout` the events, `/loop/cycle` and `/loop/devices/NAME` the header fields, whose
names are in the channel's metadata. The whole layout is attached as `layout.json`. A message's sequence number is the
row's. Its log time is the loop's clock in Unix time, its header's stamp the time of the device's sample. So nothing is
left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime import __version__
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.export.report import Report, needed, whole_file
from srl.runtime.ipc.events import Level
from srl.runtime.ipc.header import CYCLE, DEVICE
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import JOINT_STATE, STRING, Encoder, describe, time_of
from srl.runtime.profile.keys import path
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.robots import robots
from srl.runtime.ros2.joints import Joints, moved_by_devices
from srl.runtime.ros2.names import TF
from srl.runtime.ros2.tree import Tree
from srl.runtime.ros2.urdf import description

ROWS: Final = 512  # whose messages are made at a time
WORDS: Final = "std_msgs/msg/Int64MultiArray"
LOG: Final = "rcl_interfaces/msg/Log"
LEVELS: Final = {Level.INFO: 20, Level.WARNING: 30, Level.ERROR: 40}  # of LOG
LATCHED: Final = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, deadline: {sec: 0, nsec: 0}, lifespan: {sec: 0, nsec: 0}, "
    "liveliness: 1, liveliness_lease_duration: {sec: 0, nsec: 0}, avoid_ros_namespace_conventions: false}"
)  # ROS 2's quality of service of a topic whose last message is kept for those that come later

LINKS: Final = 10_000_000  # ns between two messages of joints and links, which the signals give in each row

Payloads = NDArray[np.uint8]


class _Channels:
    """The channels of a file; each kind of message has one schema."""

    def __init__(self, writer: Any) -> None:
        self.writer = writer
        self._schemas: dict[str, int] = {}
        self.count = 0

    def add(self, topic: str, kind: str, about: dict[str, Any]) -> int:
        if kind not in self._schemas:
            text = cdr.definition(kind).encode()
            self._schemas[kind] = self.writer.register_schema(kind, "ros2msg", text)
        metadata = {k: v if isinstance(v, str) else json.dumps(v) for k, v in about.items()}
        self.count += 1
        return int(self.writer.register_channel(topic, "cdr", self._schemas[kind], metadata))


def write(recording: Recording, target: Path) -> Report:
    """Writes `target`.

    Raises:
        RecordingError: it can't be written.
        HostError: the package isn't installed.
    """
    mcap = needed("mcap.writer", "--mcap")
    layout = recording.layout
    wall = int(layout.meta.get("wall", 0))
    with whole_file(target) as part, open(part, "wb") as file:
        writer = mcap.Writer(file)
        writer.start("ros2", f"srl-runtime {__version__}")
        channels = _Channels(writer)
        first = int(layout.header(recording.rows[0], "now")) + wall
        writer.add_attachment(first, first, "layout.json", "application/json", layout.text.encode())
        metadata = {"name": str(layout.meta.get("name", "")), "missing": json.dumps(recording.missing)}
        writer.add_metadata("srl", metadata)
        robot = _Robot(channels, layout, wall, first)
        sources = [*_words(channels, layout), *_signals(channels, layout, wall)]
        for at in range(0, len(recording.rows), ROWS):
            rows, sequence = recording.rows[at : at + ROWS], recording.sequence[at : at + ROWS].tolist()
            stamps = layout.header(rows, "now") + wall
            blocks: list[tuple[int, Payloads]] = [(channel, make(rows, stamps)) for channel, make in sources]
            for i, (number, stamp) in enumerate(zip(sequence, stamps.tolist(), strict=True)):
                for channel, payloads in blocks:
                    writer.add_message(channel, stamp, payloads[i].tobytes(), stamp, number)
                robot.write(rows[i], stamp, number)
        _send_events(channels, recording, wall)
        writer.finish()
    return Report([target], f"{len(recording.rows)} rows, {channels.count} topics")


def _words(channels: _Channels, layout: Layout) -> Iterator[tuple[int, Any]]:
    """The int64 words: those of the cycle, and of each device."""
    groups: list[tuple[str, slice, tuple[str, ...]]] = [("/loop/cycle", slice(0, len(CYCLE)), CYCLE._fields)]
    groups += [(f"/loop/devices/{path(d)}", layout.device(i), DEVICE._fields) for i, d in enumerate(layout.devices)]
    for topic, place, names in groups:
        dim = [{"label": "words", "size": len(names), "stride": len(names)}]
        message = {"layout": {"dim": dim, "data_offset": 0}, "data": np.zeros(len(names), np.int64)}
        head = np.frombuffer(cdr.encode(WORDS, message)[: -8 * len(names)], np.uint8)

        def make(rows: Words, _: Words, place: slice = place, head: NDArray[np.uint8] = head) -> NDArray[np.uint8]:
            words = np.ascontiguousarray(rows[:, place], "<i8").view(np.uint8)
            return np.hstack([np.tile(head, (len(rows), 1)), words])

        yield channels.add(topic, WORDS, {"labels": list(names)}), make


def _signals(channels: _Channels, layout: Layout, wall: int) -> Iterator[tuple[int, Any]]:
    """The signals, with the bus's messages. A header has the time of the device's sample."""
    topics: dict[str, str] = {}
    for field in layout.fields.values():
        topic = f"/{path(field.name)}"
        other = topics.setdefault(topic, field.name)
        if other != field.name:
            problem = f"'{field.name}' and '{other}' would have the same topic {topic}"
            raise RecordingError("--mcap", problem, "Rename one in the profile and record again, or use --parquet")
        encoder = Encoder(field)
        about = {k: v for k, v in describe(field).items() if k != "type" and v is not None}

        column = layout.stamped_by(field)

        def make(
            rows: Words, stamps: Words, name: str = field.name, encoder: Encoder = encoder, column: int = column
        ) -> NDArray[np.uint8]:
            taken = rows[:, column]
            return encoder.encode_all(layout.value(rows, name), np.where(taken < 0, stamps, taken + wall))

        yield channels.add(topic, encoder.kind, about), make


class _Robot:
    """The frames and links of the run, its joints and its URDF, as ROS 2 expects them."""

    def __init__(self, channels: _Channels, layout: Layout, wall: int, first: int) -> None:
        found = moved_by_devices(robots(layout), layout)
        self._layout, self._wall = layout, wall
        self._tree, self._joints = Tree(layout, found), Joints(layout, found)
        self._writer, self._due = channels.writer, 0
        moves = {bool(edge.signal) for edge in self._tree.edges if edge.moves}
        self._frames, self._links = True in moves, False in moves
        self._tf = channels.add("/tf", TF, {}) if moves else -1
        self._states = channels.add("/joint_states", JOINT_STATE, {}) if self._joints.names else -1
        static = self._tree.static(first)
        if static["transforms"]:
            self._latched(channels, "/tf_static", TF, static, first)
        if found:
            text = description(str(layout.meta.get("name", "robot")), layout, self._tree, self._joints)
            self._latched(channels, "/robot_description", STRING, {"data": text}, first)

    def _latched(self, channels: _Channels, topic: str, kind: str, message: cdr.Message, stamp: int) -> None:
        channel = channels.add(topic, kind, {"offered_qos_profiles": LATCHED})
        self._writer.add_message(channel, stamp, cdr.encode(kind, message), stamp, 0)

    def write(self, row: Words, stamp: int, number: int) -> None:
        """Writes what moves: frames in each row, links and joints at most every LINKS ns. `stamp`: the row's."""
        found = self._tree.moving(row, self._wall, links=False)["transforms"] if self._frames else []
        if stamp >= self._due:
            self._due = stamp + LINKS
            if self._links:
                found += self._tree.moving(row, self._wall, links=True)["transforms"]
            if self._states >= 0 and (made := self._joints.message(row, self._wall)) is not None:
                self._writer.add_message(self._states, stamp, cdr.encode(JOINT_STATE, made[1]), stamp, number)
        if found:
            self._writer.add_message(self._tf, stamp, cdr.encode(TF, {"transforms": found}), stamp, number)


def _send_events(channels: _Channels, recording: Recording, wall: int) -> None:
    """The events, each at the time of its cycle's row, or of the newest row before it."""
    channel = channels.add("/rosout", LOG, {})
    cycles, now = recording.int("cycle"), recording.int("now")
    for number, event in enumerate(recording.events, 1):
        at = max(int(np.searchsorted(cycles, event.cycle, "right")) - 1, 0)
        stamp = int(now[at]) + wall
        message = {
            "stamp": time_of(stamp), "level": LEVELS[event.level], "name": "srl", "msg": event.text, "file": "",
            "function": f"cycle {event.cycle}", "line": 0,
        }  # fmt: skip
        channels.writer.add_message(channel, stamp, cdr.encode(LOG, message), stamp, number)
