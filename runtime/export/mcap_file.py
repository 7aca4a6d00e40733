"""A recording as MCAP with ROS 2's messages: the topics of `srl.runtime.ros2.topics`.

The whole layout is attached as `layout.json`. A message's sequence number is the row's. Its log time is the loop's
clock in Unix time, its header's stamp the time of the device's sample. So nothing is left out.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.runtime import __version__
from srl.runtime.export.report import Report, needed, whole_file
from srl.runtime.messages import cdr
from srl.runtime.recording.reader import Recording
from srl.runtime.ros2.topics import Payloads, Topics

ROWS: Final = 512  # whose messages are made at a time
LINKS: Final = 10_000_000  # ns between two messages of joints and links, which the signals give in each row
SCENE: Final = 33_333_333  # ns between two messages of markers


def write(recording: Recording, target: Path) -> Report:
    """Writes `target`.

    Raises:
        RecordingError: it can't be written.
        HostError: the package isn't installed.
    """
    mcap = needed("mcap.writer", "--mcap")
    layout = recording.layout
    wall = int(layout.meta.get("wall", 0))
    first = int(layout.header(recording.rows[0], "now")) + wall
    topics = Topics(layout, first)
    with whole_file(target) as part, open(part, "wb") as file:
        writer = mcap.Writer(file)
        writer.start("ros2", f"srl-runtime {__version__}")
        writer.add_attachment(first, first, "layout.json", "application/json", layout.text.encode())
        metadata = {"name": str(layout.meta.get("name", "")), "missing": json.dumps(recording.missing)}
        writer.add_metadata("srl", metadata)
        channels = _channels(writer, topics)
        for topic in topics.all:
            if topic.kept is not None:
                writer.add_message(channels[topic.name], first, topic.kept, first, 0)
        _write_rows(writer, channels, recording, topics)
        _write_events(writer, channels, recording, topics)
        writer.finish()
    return Report([target], f"{len(recording.rows)} rows, {len(topics.all)} topics")


def _channels(writer: Any, topics: Topics) -> dict[str, int]:
    """The channels by topic; each kind of message has one schema."""
    schemas: dict[str, int] = {}
    found = {}
    for topic in topics.all:
        if topic.kind not in schemas:
            text = cdr.definition(topic.kind).encode()
            schemas[topic.kind] = writer.register_schema(topic.kind, "ros2msg", text)
        found[topic.name] = writer.register_channel(topic.name, "cdr", schemas[topic.kind], topic.about)
    return found


def _write_rows(writer: Any, channels: dict[str, int], recording: Recording, topics: Topics) -> None:
    layout, wall = recording.layout, int(recording.layout.meta.get("wall", 0))
    links_due = scene_due = 0
    for at in range(0, len(recording.rows), ROWS):
        rows, sequence = recording.rows[at : at + ROWS], recording.sequence[at : at + ROWS].tolist()
        stamps = layout.header(rows, "now") + wall
        blocks: list[tuple[int, Payloads]] = [
            (channels[topic.name], topic.encode(rows, stamps)) for topic in topics.all if topic.encode is not None
        ]
        for i, (number, stamp) in enumerate(zip(sequence, stamps.tolist(), strict=True)):
            for channel, payloads in blocks:
                writer.add_message(channel, stamp, payloads[i].tobytes(), stamp, number)
            links, scene = stamp >= links_due, stamp >= scene_due
            links_due, scene_due = stamp + LINKS if links else links_due, stamp + SCENE if scene else scene_due
            for topic, payload in topics.moving(rows[i], stamp, links=links, scene=scene):
                writer.add_message(channels[topic.name], stamp, payload, stamp, number)


def _write_events(writer: Any, channels: dict[str, int], recording: Recording, topics: Topics) -> None:
    """The events, each at the time of its cycle's row, or of the newest row before it."""
    cycles, now = recording.int("cycle"), recording.int("now")
    wall = int(recording.layout.meta.get("wall", 0))
    for number, event in enumerate(recording.events, 1):
        at = max(int(np.searchsorted(cycles, event.cycle, "right")) - 1, 0)
        stamp = int(now[at]) + wall
        topic, payload = topics.event(event, stamp)
        writer.add_message(channels[topic.name], stamp, payload, stamp, number)
