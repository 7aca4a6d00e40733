"""An MCAP is read back by other libraries than the one that wrote it, bit for bit, and holds the robot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.exported import recorded, same

from srl.runtime.export import formats
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.reader import Recording


@pytest.mark.slow
@pytest.mark.parametrize("reader", ["mcap", "rosbags"])
def test_mcap_has_every_number_for_readers_of_ros_2(reader: str, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    recording, target = recorded(without=slice(100, 140)), tmp_path / "run.mcap"
    made = formats.write("mcap", recording, target)
    assert made.left_out == []
    found = _by_mcap(target) if reader == "mcap" else _by_rosbags(target)
    stamps = (recording.int("now") + recording.layout.meta["wall"]).tolist()
    layout = recording.layout
    for topic, names in (("/loop/cycle", layout.int_names[:23]), ("/loop/devices/finger", layout.int_names[-7:])):
        assert same(np.stack([recording.int(n) for n in names], 1), np.stack([m.data for _, m in found[topic]])), topic
    for name, take in (
        ("glove/position", lambda m: m.position),
        ("finger/position_command", lambda m: m.position),
        ("hand/tips", lambda m: m.data),
        ("odd/values", lambda m: m.data),
        ("world/finger", lambda m: m.data),
    ):
        messages = found[f"/{name}"]
        assert [stamp for stamp, _ in messages] == stamps
        values = recording.value(name.replace("/", ".")).reshape(len(stamps), -1)
        assert same(values, np.array([take(m) for _, m in messages])), name
    joints = found["/finger/position_command"][3][1]
    assert list(joints.name) == ["abduction", "mcp", "pip", "dip"]
    assert joints.header.stamp.sec * 10**9 + joints.header.stamp.nanosec == stamps[3]
    poses, transforms = found["/hand/pose"], dict(found["/tf"])
    assert len(transforms) == 600 - 40 - 99  # none before the first sample
    for i, (stamp, message) in enumerate(poses):
        p, q = message.pose.position, message.pose.orientation
        assert same(recording.value("hand.pose")[i], np.array([p.x, p.y, p.z, q.w, q.x, q.y, q.z]))
        if stamp in transforms:
            (moving,) = transforms[stamp].transforms
            assert (moving.header.frame_id, moving.child_frame_id) == ("base", "hand")
            # By the profile's frame, turned by 0.5 rad about z: `make_layout`.
            at = moving.transform.translation
            expected = [0.1 + p.x * np.cos(0.5) - p.y * np.sin(0.5), p.x * np.sin(0.5) + p.y * np.cos(0.5), p.z]
            assert np.allclose([at.x, at.y, at.z], expected, atol=1e-12)
    ((_, event),) = found["/rosout"]
    assert (event.msg, event.level, event.function) == (recording.events[0].text, 30, "cycle 100")


def test_mcap_has_the_robot_with_the_time_of_its_samples(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    graph = wiring.build(*profile.load("so101"), [])
    step, rows = Lockstep(graph), []
    for _ in range(40):
        step.step()
        rows.append(graph.row.words.copy())
    layout = graph.layout
    recording = Recording(tmp_path / "made-up.rrd", layout, np.arange(40), np.array(rows), [], [], 0)
    formats.write("mcap", recording, tmp_path / "run.mcap")
    found = _by_mcap(tmp_path / "run.mcap")
    ((_, described),) = found["/robot_description"]
    model = pin.buildModelFromXML(described.data)
    _, joints = found["/joint_states"][-1]
    assert set(joints.name) <= set(model.names)
    frames = {t.child_frame_id for topic in ("/tf", "/tf_static") for _, m in found[topic] for t in m.transforms}
    bodies = {frame.name for frame in model.frames if frame.type == pin.BODY}
    assert bodies - frames <= {"universe", *(name for name in bodies if "/" not in name)}
    wall = layout.meta["wall"]
    sampled = recording.int("arm.stamp")
    assert (sampled < recording.int("now"))[5:].any(), "a sample is older than its row"
    for (logged, message), taken, now in zip(found["/arm/position"], sampled, recording.int("now"), strict=True):
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        assert stamp == wall + (taken if taken >= 0 else now)
        assert logged == wall + now


def test_mcap_names_elements_and_units_and_holds_the_layout(tmp_path: Path) -> None:
    reading = pytest.importorskip("mcap.reader")
    recording = recorded(20)
    formats.write("mcap", recording, tmp_path / "run.mcap")
    with open(tmp_path / "run.mcap", "rb") as file:
        reader = reading.make_reader(file)
        about = {c.topic: c.metadata for c in reader.get_summary().channels.values()}
        (kept,) = list(reader.iter_attachments())
    assert about["/hand/tips"]["unit"] == "m"
    assert about["/hand/tips"]["frame"] == "hand"
    assert json.loads(about["/hand/tips"]["labels"]) == ["thumb", "index", "middle", "ring", "little"]
    assert json.loads(about["/loop/cycle"]["labels"]) == recording.layout.int_names[:23]
    assert json.loads(kept.data)["meta"] == recording.layout.meta


def _by_mcap(target: Path) -> dict[str, list[tuple[int, Any]]]:
    from mcap.reader import make_reader

    decoder = pytest.importorskip("mcap_ros2.decoder")
    found: dict[str, list[tuple[int, Any]]] = {}
    with open(target, "rb") as file:
        reader = make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def _by_rosbags(target: Path) -> dict[str, list[tuple[int, Any]]]:
    from rosbags.highlevel import AnyReader

    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([target]) as reader:
        for connection, stamp, raw in reader.messages():
            found.setdefault(connection.topic, []).append((stamp, reader.deserialize(raw, connection.msgtype)))
    return found
