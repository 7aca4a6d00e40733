"""The scene in an MCAP, read by others: it is where tf and the simulation are, for every shipped profile."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import ROOT
from rosbags.highlevel import AnyReader

from srl.runtime.export import formats
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.shapes import visuals

PROFILES = sorted(path.stem for path in (ROOT / "profiles").glob("*.yaml"))
SPHERE, CYLINDER, LINE_LIST, SPHERE_LIST = 2, 3, 5, 7
DELETE_ALL = 3
CLOSE = 1e-9  # m
Matrix = np.ndarray[Any, Any]


def simulated(name: str, folder: Path, cycles: int = 120) -> Recording:
    """The first cycles of a profile whose devices are all simulated."""
    graph = wiring.build(*profile.load(name), [])
    step, rows = Lockstep(graph), []
    for _ in range(cycles):
        step.step()
        rows.append(graph.row.words.copy())
    return Recording(folder / "made-up.rrd", graph.layout, np.arange(cycles), np.array(rows), [], [], 0)


def exported(recording: Recording, folder: Path) -> dict[str, list[tuple[int, Any]]]:
    """The messages by topic, as rosbags reads them, the oldest first."""
    formats.write("mcap", recording, folder / "run.mcap")
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([folder / "run.mcap"]) as reader:
        for connection, stamp, raw in reader.messages():
            found.setdefault(connection.topic, []).append((stamp, reader.deserialize(raw, connection.msgtype)))
    return found


def matrix(place: Any, turn: Any) -> Matrix:
    return np.asarray(
        pin.XYZQUATToSE3(np.array([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])).homogeneous
    )


class Frames:
    """tf as a viewer keeps it: each child's newest transform until a time."""

    def __init__(self, messages: dict[str, list[tuple[int, Any]]], until: int) -> None:
        self._of: dict[str, tuple[str, Matrix]] = {}
        for topic in ("/tf_static", "/tf"):
            for stamp, message in messages.get(topic, ()):
                for t in message.transforms if stamp <= until else ():
                    place = matrix(t.transform.translation, t.transform.rotation)
                    self._of[t.child_frame_id] = (t.header.frame_id, place)

    def root_of(self, frame: str) -> tuple[str, Matrix]:
        place = np.eye(4)
        while frame in self._of:
            frame, own = self._of[frame]
            place = own @ place
        return frame, place


def moved(place: Matrix, points: Matrix) -> Matrix:
    return points @ place[:3, :3].T + place[:3, 3]


def points_of(marker: Any) -> Matrix:
    return np.array([[p.x, p.y, p.z] for p in marker.points]).reshape(-1, 3)


@pytest.mark.slow
@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", PROFILES)
def test_what_has_a_shape_is_where_tf_and_the_simulation_say(name: str, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    recording = simulated(name, tmp_path)
    messages = exported(recording, tmp_path)
    layout = recording.layout
    drawn = {robot["name"] for robot in layout.meta.get("robots", ())}
    fields = [
        f for f in visuals(layout) if f.name not in {f"world.{r}_{w}" for r in drawn for w in ("links", "outline")}
    ]
    assert bool(fields) == ("/scene" in messages)
    if not fields:
        return
    stamp, scene = messages["/scene"][-1]
    (i,) = np.flatnonzero(recording.int("now") + layout.meta["wall"] == stamp)
    first, *markers = scene.markers
    assert first.action == DELETE_ALL
    frames = Frames(messages, stamp)
    (root,) = {marker.header.frame_id for marker in markers} or {""}
    assert root not in frames._of
    assert len({(marker.ns, marker.id) for marker in markers}) == len(markers)
    for field in fields:
        own = [marker for marker in markers if marker.ns == field.name]
        above, place = frames.root_of(field.frame) if field.frame is not None else (root, np.eye(4))
        if above != root:  # a frame that the profile doesn't have counts as the root
            assert above == field.frame
        values = recording.value(field.name)[i]
        if field.visual in ("points", "skeleton", "robot"):
            points = values.reshape(-1, 3)
            points = points[np.isfinite(points).all(axis=1)] if points.any() or len(points) == 1 else points[:0]
            (balls,) = [m for m in own if m.type == SPHERE_LIST] or [None]
            found = points_of(balls) if balls is not None else np.empty((0, 3))
            assert np.abs(found - moved(place, points)).max(initial=0) < CLOSE, field.name
        elif field.visual == "capsules":
            known = values[np.isfinite(values[:, :7]).all(axis=1)]
            ends = moved(place, known[:, :6].reshape(-1, 3)).reshape(-1, 6)
            long = np.linalg.norm(known[:, 3:6] - known[:, :3], axis=1) > 0
            balls = [m.pose.position for m in own if m.type == SPHERE]  # one at each end
            found = np.array(sorted((p.x, p.y, p.z) for p in balls))
            expected = np.concatenate([ends[:, :3], ends[long, 3:]])
            assert len(found) == len(expected)
            assert all(np.abs(found - end).max(axis=1).min() < CLOSE for end in expected)
            cylinders = [m for m in own if m.type == CYLINDER]
            assert len(cylinders) == long.sum()
            for marker, row, radius in zip(cylinders, ends[long], known[long, 6], strict=True):
                at = matrix(marker.pose.position, marker.pose.orientation)
                tips = [moved(at, np.array([[0, 0, z * marker.scale.z / 2]]))[0] for z in (-1, 1)]
                assert np.abs(np.concatenate(tips) - row).max() < CLOSE
                assert marker.scale.x == marker.scale.y == pytest.approx(2 * radius)
        elif field.visual == "gaps":
            known = values[np.isfinite(values[:, :6]).all(axis=1)]
            (lines,) = [m for m in own if m.type == LINE_LIST] or [None]
            found = points_of(lines) if lines is not None else np.empty((0, 3))
            assert np.abs(found - moved(place, known[:, :6].reshape(-1, 3))).max(initial=0) < CLOSE


@pytest.mark.slow
@pytest.mark.parametrize("reader", ["mcap", "rosbags"])
def test_both_readers_read_the_same_markers(reader: str, tmp_path: Path) -> None:
    decoder = pytest.importorskip("mcap_ros2.decoder")
    recording = simulated("human-srl", tmp_path)
    messages = exported(recording, tmp_path)
    if reader == "mcap":
        from mcap.reader import make_reader

        with open(tmp_path / "run.mcap", "rb") as file:
            found = make_reader(file, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages(["/scene"])
            *_, (_, _, _, scene) = found
        other = messages["/scene"][-1][1]
        for mine, theirs in zip(scene.markers, other.markers, strict=True):
            assert (mine.ns, mine.id, mine.type, mine.header.frame_id) == (
                theirs.ns, theirs.id, theirs.type, theirs.header.frame_id,
            )  # fmt: skip
            assert np.array_equal(points_of(mine), points_of(theirs))
            assert [(c.r, c.g, c.b, c.a) for c in mine.colors] == [(c.r, c.g, c.b, c.a) for c in theirs.colors]
    kinds = {marker.ns: marker.type for marker in messages["/scene"][-1][1].markers}
    assert {"skeleton.nodes", "collision.envelope", "collision.closest", "world.arm_tip"} <= kinds.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda-jog", "ur-jog"])
def test_the_urdf_with_tf_is_where_the_simulated_arm_is(name: str, tmp_path: Path) -> None:
    """The links of `/robot_description`, moved by `/joint_states` and placed by tf, against MuJoCo's bodies."""
    recording = simulated(name, tmp_path)
    messages = exported(recording, tmp_path)
    stamp, joints = messages["/joint_states"][-1]
    model = pin.buildModelFromXML(messages["/robot_description"][0][1].data)
    bodies = [frame.name for frame in model.frames if frame.type == pin.BODY and frame.name.startswith("arm/")]

    def by_urdf(names: Any, values: Any) -> Matrix:
        data, q = model.createData(), pin.neutral(model)
        for joint, value in zip(names, values, strict=True):
            entry = model.joints[model.getJointId(joint)]
            q[entry.idx_q : entry.idx_q + entry.nq] = value if entry.nq == 1 else (np.cos(value), np.sin(value))
        pin.framesForwardKinematics(model, data, q)
        return np.array([data.oMf[model.getFrameId(body)].translation for body in bodies])

    frames = Frames(messages, stamp)
    by_tf = np.array([frames.root_of(body)[1][:3, 3] for body in bodies])
    assert np.abs(by_urdf(joints.name, joints.position) - by_tf).max() < 1e-6
    # What the joints measure is noisy: the simulation's bodies are where their true angles are.
    (i,) = np.flatnonzero(recording.int("now") + recording.layout.meta["wall"] == stamp)
    true = by_urdf(joints.name, recording.value("world.arm_position")[i])
    for point in recording.value("world.arm_links")[i]:
        assert np.linalg.norm(true - point, axis=1).min() < 1e-6


def test_a_robot_of_its_own_urdf_has_plain_shapes_and_names_no_file(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    messages = exported(simulated("so101", tmp_path, 5), tmp_path)
    text = messages["/robot_description"][0][1].data
    assert "<mesh" not in text
    assert "file:" not in text
    assert text.count("<visual") >= 6
