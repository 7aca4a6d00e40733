"""A recording as MCAP with ROS 2's messages: a topic for each signal, and the frames as transforms.

Topics are named as on the bus: `/finger/position_command`. A channel's metadata has the signal's name, unit, labels and
components, as the bus's metadata has them. `/tf_static` and `/tf` hold the frames, `/rosout` the events, `/loop/cycle`
and `/loop/devices/NAME` the int64 words, whose names are in the channel's metadata. The whole layout is attached as
`layout.json`. A message's sequence number is the row's. Its log time is the loop's clock in Unix time. So nothing is
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
from srl.runtime.contracts.frames import FrameEntry, as_pose, is_pose
from srl.runtime.contracts.rotation import Pose, composed
from srl.runtime.export.report import Report, needed, whole_file
from srl.runtime.ipc.events import Level
from srl.runtime.ipc.header import CYCLE, DEVICE
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.messages import cdr
from srl.runtime.messages.messages import Encoder, describe, time_of
from srl.runtime.profile.keys import path
from srl.runtime.recording.reader import Recording

ROWS: Final = 512  # whose messages are made at a time
WORDS: Final = "std_msgs/msg/Int64MultiArray"
TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
LOG: Final = "rcl_interfaces/msg/Log"
LEVELS: Final = {Level.INFO: 20, Level.WARNING: 30, Level.ERROR: 40}  # of LOG
LATCHED: Final = (
    "- {history: 1, depth: 1, reliability: 1, durability: 1, deadline: {sec: 0, nsec: 0}, lifespan: {sec: 0, nsec: 0}, "
    "liveliness: 1, liveliness_lease_duration: {sec: 0, nsec: 0}, avoid_ros_namespace_conventions: false}"
)  # ROS 2's quality of service of a topic whose last message is kept for those that come later
ROOT: Final = "root"  # the parent of the frames that have none

Payloads = NDArray[np.uint8] | list[bytes | None]


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
        fixed, measured = _frames(layout)
        if fixed:
            _send_fixed(channels, fixed, first)
        sources = [*_words(channels, layout), *_signals(channels, layout)]
        moving = channels.add("/tf", TRANSFORMS, {}) if measured else None
        for at in range(0, len(recording.rows), ROWS):
            rows, sequence = recording.rows[at : at + ROWS], recording.sequence[at : at + ROWS].tolist()
            stamps = layout.header(rows, "now") + wall
            blocks: list[tuple[int, Payloads]] = [(channel, make(rows, stamps)) for channel, make in sources]
            if moving is not None:
                blocks.append((moving, list(_transforms(layout, measured, rows, stamps))))
            for i, (number, stamp) in enumerate(zip(sequence, stamps.tolist(), strict=True)):
                for channel, payloads in blocks:
                    payload = payloads[i]
                    if payload is not None:
                        data = payload if isinstance(payload, bytes) else payload.tobytes()
                        writer.add_message(channel, stamp, data, stamp, number)
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


def _signals(channels: _Channels, layout: Layout) -> Iterator[tuple[int, Any]]:
    """The signals, with the bus's messages."""
    topics: dict[str, str] = {}
    for field in layout.fields.values():
        topic = f"/{path(field.name)}"
        other = topics.setdefault(topic, field.name)
        if other != field.name:
            problem = f"'{field.name}' and '{other}' would have the same topic {topic}"
            raise RecordingError("--mcap", problem, "Rename one in the profile and record again, or use --parquet")
        encoder = Encoder(field)
        about = {k: v for k, v in describe(field).items() if k != "type" and v is not None}

        def make(rows: Words, stamps: Words, name: str = field.name, encoder: Encoder = encoder) -> NDArray[np.uint8]:
            return encoder.encode_all(layout.value(rows, name), stamps)

        yield channels.add(topic, encoder.kind, about), make


def _frames(layout: Layout) -> tuple[dict[str, FrameEntry], dict[str, FrameEntry]]:
    """The frames that are fixed in their parents, and the measured ones. A root has no transform."""
    entries = {n: FrameEntry.recorded(f) for n, f in layout.meta.get("frames", {}).items()}
    measured = {n: e for n, e in entries.items() if e.pose in layout.fields}
    return {n: e for n, e in entries.items() if n not in measured and e.parent is not None}, measured


def _transform(name: str, entry: FrameEntry, pose: Pose, stamp: int) -> cdr.Message:
    x, y, z, qw, qx, qy, qz = pose
    return {
        "header": {"stamp": time_of(stamp), "frame_id": entry.parent or ROOT},
        "child_frame_id": name,
        "transform": {
            "translation": {"x": x, "y": y, "z": z},
            "rotation": {"x": qx, "y": qy, "z": qz, "w": qw},
        },
    }


def _send_fixed(channels: _Channels, fixed: dict[str, FrameEntry], stamp: int) -> None:
    found = [_transform(name, entry, entry.placed(), stamp) for name, entry in fixed.items()]
    about = {"offered_qos_profiles": LATCHED}
    payload = cdr.encode(TRANSFORMS, {"transforms": found})
    channels.writer.add_message(channels.add("/tf_static", TRANSFORMS, about), stamp, payload, stamp, 0)


def _transforms(layout: Layout, measured: dict[str, FrameEntry], rows: Words, stamps: Words) -> Iterator[bytes | None]:
    """The measured frames in their parents, a message a row. What isn't seen in a row isn't in its message."""
    values = {name: layout.value(rows, str(entry.pose)) for name, entry in measured.items()}
    mounts = {name: entry.placed() for name, entry in measured.items()}
    for i, stamp in enumerate(stamps.tolist()):
        found = [
            _transform(name, entry, composed(mounts[name], as_pose(values[name][i])), stamp)
            for name, entry in measured.items()
            if is_pose(values[name][i])
        ]
        yield cdr.encode(TRANSFORMS, {"transforms": found}) if found else None


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
