"""Motion files as devices: BVH, MVNX and C3D are what the capture systems' own drivers would give."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import c3d
import numpy as np
import pytest
from helpers import c3d_files, mvnx
from helpers.zenoh import bound
from mvnx_parser.parser import Mvnx_p
from pydantic import ValidationError

from srl.drivers.capture import c3d as ours
from srl.drivers.capture import view
from srl.drivers.capture.config import CaptureConfig
from srl.drivers.noitom.config import signals as suit_signals
from srl.drivers.noitom.skeleton import Skeleton
from srl.drivers.replay import Replay, ReplayConfig, suit_motion
from srl.drivers.xsens_mvn.config import MvnConfig
from srl.drivers.xsens_mvn.config import signals as mvn_signals
from srl.drivers.xsens_mvn.mvnx import read
from srl.drivers.xsens_mvn.protocol import JOINT_ENDS, SEGMENTS
from srl.runtime.contracts.errors import DeviceLostError, RecordingError
from srl.runtime.contracts.rotation import EulerQuaternions
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton import bvh
from srl.runtime.models.skeleton.tree import Node, Tree

NEURON = Skeleton("axis-neuron")
MS = 1_000_000


def motion(n: int = 12, seed: int = 3) -> tuple[Array, Array]:
    """(n, 59, 4), (n, 59, 3) m: a body whose joints but the fingers turn, on rigid bones."""
    rng = np.random.default_rng(seed)
    rotation = np.tile([1.0, 0.0, 0.0, 0.0], (n, 59, 1))
    quaternions = EulerQuaternions("YXZ", n)
    for i, name in enumerate(NEURON.names):
        if name in mvnx.JOINT_OF.values():
            phase, size = rng.uniform(0.0, 6.0, 3), rng.uniform(-0.6, 0.6, 3)
            quaternions.fill(size * np.sin(np.arange(n)[:, None] / 8.0 + phase), rotation[:, i])
    translation = np.tile(NEURON.offsets, (n, 1, 1))
    translation[:, 0, 2] += np.arange(n) * 0.01
    return rotation, translation


@pytest.fixture
def mvnx_file(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    p, q = mvnx.of_suit(NEURON, *motion())
    path = tmp_path / "walk.mvnx"
    rest = {"identity": (p[0], q[0]), "tpose": (p[1], q[1])}
    path.write_text(mvnx.text(p, q, 60.0, joints=rng.normal(size=(12, 22, 3)), centre=p[:, 0], poses=rest))
    return path


def played(path: Path, **options: Any) -> Replay:
    device = Replay("suit", ReplayConfig(recording=path, **options))
    bound(device)
    device.open()
    return device


def at(device: Replay, ms: int) -> dict[str, Array]:
    """The states `ms` after the first reading at 10 s."""
    device.read(10_000 * MS + ms * MS)
    return {name: array.copy() for name, array in device.state_arrays.items()}


# -- MVNX


def test_mvnx_is_read_as_another_reader_reads_it(mvnx_file: Path) -> None:
    file, other = read(mvnx_file), Mvnx_p(str(mvnx_file))
    theirs = {name: np.array(getattr(other, name), float) for name in ("position", "orientation", "jointAngle")}
    np.testing.assert_array_equal(file.position, theirs["position"])
    np.testing.assert_allclose(file.orientation, theirs["orientation"], atol=2e-6)  # which is made of length 1
    assert file.joint_angles is not None
    assert file.centre_of_mass is not None
    np.testing.assert_allclose(np.rad2deg(file.joint_angles), theirs["jointAngle"], atol=1e-12)
    np.testing.assert_array_equal(file.centre_of_mass, np.array(other.centerOfMass, float)[:, 0])
    assert (file.segments, file.joints, file.rate) == (SEGMENTS, tuple(JOINT_ENDS), 60.0)
    assert list(file.poses) == ["identity", "tpose"]
    assert file.recorded == 1_767_322_800_000


def test_an_mvnx_file_gives_what_the_suits_driver_gives(mvnx_file: Path) -> None:
    options: dict[str, Any] = {
        "segments": {"chest": "T8", "arm": "RightUpperArm"}, "joints": ("RightElbow",), "centre_of_mass": True,
        "frame": "room",
    }  # fmt: skip
    device = played(mvnx_file, **options)
    assert device.states == mvn_signals(MvnConfig(port="udp://:9763", **options))
    p, q = mvnx.of_suit(NEURON, *motion())
    first, third = at(device, 0), at(device, 34)
    chest = SEGMENTS.index("T8")
    for values, frame in ((first, 0), (third, 2)):
        np.testing.assert_allclose(values["pose"][0, :3], p[frame, chest], atol=1e-6)
        assert abs(values["chest.pose"][3:] @ q[frame, chest]) == pytest.approx(1.0, abs=1e-9)
        np.testing.assert_allclose(values["centre_of_mass"], p[frame, 0], atol=1e-6)
        assert values["visible"].tolist() == [1.0, 1.0]
    angles = np.random.default_rng(0).normal(size=(12, 22, 3))[2, list(JOINT_ENDS).index("RightElbow")]
    np.testing.assert_allclose(third["joint_angles"][0], np.deg2rad(angles), atol=1e-8)
    assert device.health.stamp == 10_000 * MS + round(2e9 / 60)


def test_without_names_an_mvnx_file_gives_all_segments(mvnx_file: Path) -> None:
    assert Replay("suit", ReplayConfig(recording=mvnx_file)).states == mvn_signals(MvnConfig(port="udp://:9763"))


def test_a_file_ends_and_begins_as_a_recording_does(mvnx_file: Path) -> None:
    device = played(mvnx_file, start=0.1)
    p, _ = mvnx.of_suit(NEURON, *motion())
    np.testing.assert_allclose(at(device, 0)["pose"][0, :3], p[6, 0], atol=1e-6)
    with pytest.raises(DeviceLostError, match="the recording is over"):
        at(device, 500)
    np.testing.assert_allclose(at(played(mvnx_file, at_end="hold"), 0)["pose"][0, :3], p[0, 0], atol=1e-6)


def test_mvn_and_bvh_of_one_motion_are_the_same_suit(mvnx_file: Path, tmp_path: Path) -> None:
    """The BVH of the suit's joints, and MVN's segments of the same body made by matrices."""
    rotation, translation = motion()
    names = NEURON.names
    tree = Tree(Node(name, "" if up < 0 else names[up], tuple(NEURON.offsets[i]))
                for i, (name, up) in enumerate(zip(names, NEURON.parents, strict=True)))  # fmt: skip
    bvh.write(tmp_path / "walk.bvh", tree, rotation, translation, 1.0 / 60.0)
    one, other = (suit_motion.read(path, NEURON) for path in (tmp_path / "walk.bvh", mvnx_file))
    assert np.abs((one.rotation * other.rotation).sum(axis=2)) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(one.translation, other.translation, atol=1e-5)
    np.testing.assert_allclose(one.offsets, other.offsets, atol=1e-5)
    np.testing.assert_allclose(one.times, other.times, atol=1e-6)
    for path in (tmp_path / "walk.bvh", mvnx_file):
        device = played(path, skeleton="axis-neuron")
        assert device.states == suit_signals(NEURON)
        at(device, 0)
        np.testing.assert_allclose(at(device, 100)["translation"], translation[6], atol=1e-5)


def test_what_an_mvnx_file_lacks_is_named(mvnx_file: Path, tmp_path: Path) -> None:
    p, q = mvnx.of_suit(NEURON, *motion())
    few = tmp_path / "few.mvnx"
    few.write_text(mvnx.text(p[:, :5], q[:, :5], segments=SEGMENTS[:5]))
    assert Replay("suit", ReplayConfig(recording=few)).states[0].labels == ("pelvis", "l5", "l3", "t12", "t8")
    for options, words in (
        ({"segments": {"head": "Head"}}, "no segment 'Head'"), ({"joints": ("RightElbow",)}, "no joint angles"),
        ({"centre_of_mass": True}, "no centre of mass"), ({"skeleton": "axis-neuron"}, "no segment 'Neck'"),
        ({"start": 9.0}, "nothing of what is wanted after 9 s"),
    ):  # fmt: skip
        with pytest.raises(RecordingError, match=words):
            Replay("suit", ReplayConfig(recording=few, **options))  # type: ignore[arg-type]


@pytest.mark.parametrize(("options", "words"), [
    ({"recording": "a.mvnx", "markers": {"a": "A/B"}}, "'markers' is no option of a motion file .mvnx"),
    ({"recording": "a.c3d", "segments": {"a": "T8"}}, "'segments' is no option of a motion file .c3d"),
    ({"recording": "a.bvh", "frame": "room"}, "'frame' is no option"),
    ({"recording": "a.rrd"}, "name the recorded 'device'"),
    ({"recording": "a.rrd", "device": "suit", "skeleton": "axis-neuron"}, "no option of a recording of srl"),
    ({"recording": "a.mvnx", "device": "suit"}, "'device' is no option"),
    ({"recording": "a.mvnx", "segments": {"chest": "T9"}}, "no segment 'T9'"),
    ({"recording": "a.c3d", "markers": {"Chest": "C7"}}, "can't be a name here"),
])  # fmt: skip
def test_options_of_another_kind_of_file_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        ReplayConfig(**options)


# -- C3D


@pytest.fixture
def c3d_file(tmp_path: Path) -> Path:
    hidden = np.zeros((20, 3), bool)
    hidden[5:9, 1] = hidden[0, 2] = True
    path = tmp_path / "trial.c3d"
    path.write_bytes(c3d_files.content(c3d_files.markers(), hidden=hidden))
    return path


@pytest.mark.slow
def test_a_c3d_file_gives_what_a_marker_system_gives(c3d_file: Path) -> None:
    wanted = {"c7": "Anna/C7", "clav": "Anna/CLAV"}
    device = played(c3d_file, markers=wanted, frame="room")
    assert device.states == view.signals(CaptureConfig(markers=wanted, frame="room"))
    points = c3d_files.markers()
    for frame in (0, 4, 9):
        values = at(device, 10 * frame)
        np.testing.assert_allclose(values["markers"], points[frame, [1, 0]], atol=1e-6)
        assert values["marker_visible"].tolist() == [1.0, 1.0]
    device = played(c3d_file, markers=wanted, start=0.04)
    at(device, 0)
    values = at(device, 30)  # hidden: it stays where it was seen last
    np.testing.assert_allclose(values["markers"], points[[4, 7], [1, 0]], atol=1e-6)
    assert values["marker_visible"].tolist() == [0.0, 1.0]
    device = played(c3d_file, markers=wanted, required=["c7"])
    at(device, 0)
    at(device, 40)
    stamp = device.health.stamp
    at(device, 80)
    assert device.health.stamp == stamp, "a frame without what is required is no sample"
    at(device, 95)
    assert device.health.stamp == 10_000 * MS + 90 * MS
    everything = Replay("mocap", ReplayConfig(recording=c3d_file))
    assert everything.states[0].labels == ("clav", "c7", "lasi")
    with pytest.raises(RecordingError, match=r"no marker 'Anna/C8'.*C7"):
        Replay("mocap", ReplayConfig(recording=c3d_file, markers={"c8": "Anna/C8"}))


@pytest.mark.slow
def test_units_subjects_and_the_axis_that_is_up(tmp_path: Path) -> None:
    points, path = c3d_files.markers(4), tmp_path / "a.c3d"
    for unit in ("mm", "cm", "m"):
        path.write_bytes(c3d_files.content(points, unit=unit, rate=59.94))
        file = ours.read(path)
        np.testing.assert_allclose(file.points, points, atol=1e-6)
        assert file.rate == pytest.approx(59.94, abs=1e-3)
    path.write_bytes(c3d_files.content(points, ("A:C7", "B:C7", "T10")))
    file = ours.read(path)
    assert file.subjects == ("A", "B", "")
    assert [file.index(name) for name in ("A/C7", "B/C7", "T10", "C7", "B/T10")] == [0, 1, 2, -1, -1]
    assert Replay("mocap", ReplayConfig(recording=path)).states[0].labels == ("a_c7", "b_c7", "t10")
    path.write_bytes(c3d_files.content(points, ("CLAV", "C7", "T10"), screen="+Y"))
    turned = points[..., [0, 2, 1]] * [1.0, -1.0, 1.0]  # y up, as OptiTrack has it
    np.testing.assert_allclose(ours.read(path).points, turned, atol=1e-6)
    np.testing.assert_allclose(ours.read(path, "z").points, points, atol=1e-6)
    assert ours.read(path).index("Anna/C7") == 1, "no subject is named in the file"
    assert set(ours.read(path).trial()) == {"CLAV", "C7", "T10"}


@pytest.mark.slow
def test_a_force_plates_wrench_is_in_the_worlds_axes(tmp_path: Path) -> None:
    """A person of 700 N: the ground's reaction is up, and the plate's z is down, its x backwards."""
    n = 6
    wrench = np.zeros((n, 6))
    wrench[:, 2], wrench[:, 3] = -700.0, 70.0
    c3d_files.with_plate(tmp_path / "a.c3d", c3d_files.markers(n), wrench)
    value = at(played(tmp_path / "a.c3d", plates=True), 0)["plate1.wrench"]
    np.testing.assert_allclose(value, [0, 0, 700, -70, 0, 0], atol=1e-3)
    c3d_files_without = tmp_path / "b.c3d"
    c3d_files_without.write_bytes(c3d_files.content(c3d_files.markers(4)))
    with pytest.raises(RecordingError, match="no force plate"):
        Replay("mocap", ReplayConfig(recording=c3d_files_without, plates=True))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "unit"), [
    ("vicon_plug_in_gait/Movement_trial.c3d", 1e-3), ("optitrack_upper_body/kinematics_tennis_serve_nan.c3d", 1.0),
    ("vicon_upper_limb_emg/markers_analogs.c3d", 1e-3),
])  # fmt: skip
def test_real_files_are_read_as_another_reader_reads_them(name: str, unit: float) -> None:
    from helpers.shared import shared

    path = shared(f"data/{name}")
    found = ours.read(path, "z")
    with path.open("rb") as stream, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file has no analog channels
        reader = c3d.Reader(stream)
        labels = [label.strip() for label in reader.point_labels]
        rows = np.array([points[:, :4] for _, points, _ in reader.read_frames()], float)
    theirs = np.where(rows[..., 3:] < 0, np.nan, rows[..., :3] * unit)[:, [labels.index(n) for n in found.labels]]
    np.testing.assert_allclose(found.points, theirs, atol=1e-6)
