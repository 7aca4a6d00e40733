"""The tree of frames, against scipy's rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import RigidTransform, Rotation

from srl.runtime.contracts import rotation
from srl.runtime.contracts.frames import FrameEntry, FrameError, Frames, Measured, Placement, as_pose, is_pose
from srl.runtime.contracts.rotation import Pose
from srl.runtime.contracts.signals import Array

numbers = st.floats(-3.0, 3.0)
triples = st.tuples(numbers, numbers, numbers)
quaternions = st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: float(np.linalg.norm(q)) > 0.1)


def rigid(pose: Any) -> RigidTransform:
    """scipy's transform of a pose."""
    return RigidTransform.from_components(pose[:3], Rotation.from_quat(pose[3:], scalar_first=True))


@given(position=triples, rpy=triples)
def test_rpy_is_yaw_after_pitch_after_roll(position: Any, rpy: Any) -> None:
    pose = Placement(position=position, rpy=rpy).placed()
    assert rotation.homogeneous(pose) == pytest.approx(
        RigidTransform.from_components(position, Rotation.from_euler("xyz", rpy)).as_matrix(), abs=1e-12
    )


@given(position=triples, q=quaternions)
def test_a_quaternion_is_w_first_and_of_any_length(position: Any, q: Any) -> None:
    pose = Placement(position=position, quaternion=q).placed()
    assert rotation.homogeneous(pose) == pytest.approx(rigid((*position, *q)).as_matrix(), abs=1e-12)


@given(p=triples, q=quaternions, a=triples, b=triples)
def test_poses_are_composed_and_inverted(p: Any, q: Any, a: Any, b: Any) -> None:
    one, two = Placement(position=p, quaternion=q).placed(), Placement(position=a, rpy=b).placed()
    both = rotation.composed(one, rotation.inverted(two))
    assert rotation.homogeneous(both) == pytest.approx((rigid(one) * rigid(two).inv()).as_matrix(), abs=1e-9)


@given(a=triples, b=triples, p=triples)
def test_a_point_goes_through_the_tree_and_back(a: Any, b: Any, p: Any) -> None:
    """world <- chest (fixed) <- hand (measured); tool hangs on the world."""
    frames = Frames(
        {
            "world": FrameEntry(),
            "chest": FrameEntry(parent="world", position=a, rpy=b),
            "hand": FrameEntry(parent="chest", position=(0.1, 0.0, 0.0), pose="mocap.hand"),
            "tool": FrameEntry(parent="world", position=b, rpy=a),
        }
    )
    pose = np.array([0.3, -0.2, 0.5, *Rotation.from_euler("xyz", p).as_quat(scalar_first=True)])

    def at(target: str, source: str) -> Array:
        measured = Measured(frames, frames.path(target, source), {"mocap.hand": pose})
        measured.update()
        return rotation.homogeneous(measured.pose)

    chest, tool = Rotation.from_euler("xyz", b), Rotation.from_euler("xyz", a)
    point = np.array(p)
    in_chest = Rotation.from_euler("xyz", p).apply(point) + pose[:3] + [0.1, 0.0, 0.0]
    in_tool = tool.inv().apply(chest.apply(in_chest) + a - np.array(b))
    assert (at("tool", "hand") @ [*point, 1.0])[:3] == pytest.approx(in_tool, abs=1e-9)
    assert at("hand", "tool") @ at("tool", "hand") == pytest.approx(np.eye(4), abs=1e-9)
    pose[:3] += 1.0  # measured anew
    assert at("chest", "hand")[:3, 3] == pytest.approx(np.array([0.4, -0.2, 0.5]) + 1.0)
    assert frames.fixed(frames.path("tool", "chest")) == pytest.approx(
        rotation.composed(rotation.inverted((*b, *_q(a))), (*a, *_q(b))), abs=1e-12
    )


def _q(rpy: Any) -> tuple[float, float, float, float]:
    return rotation.from_rpy(*rpy)


def test_one_edge_keeps_its_bits() -> None:
    """A mount is given to the law as it was written."""
    place: Pose = (0.22, -0.1, 0.529, *rotation.normalised((0.7, 0.1, 0.7, -0.1)))
    frames = Frames({"base": FrameEntry(), "arm": FrameEntry(parent="base", position=place[:3], quaternion=place[3:])})
    assert frames.fixed(frames.path("base", "arm")) == place


@pytest.mark.parametrize(
    ("parents", "known", "problem"),
    [
        ({"a": "b"}, (), "no frame is called 'b'"),
        ({"a": "b", "b": "c", "c": "a"}, (), "circle"),
        ({"a": "arm/flange"}, (), "no frame is called 'arm/flange'"),
        ({"arm/flange": None}, (), "link's name"),
    ],
)
def test_circles_and_orphans_are_refused(parents: dict[str, str | None], known: tuple[str, ...], problem: str) -> None:
    with pytest.raises(FrameError, match=problem):
        Frames({name: FrameEntry(parent=parent) for name, parent in parents.items()}, known)


@pytest.mark.parametrize(
    ("target", "source", "problem"),
    [
        ("base", "tool", "'arm/flange' moves with 'arm' or its joints.*tool-pose"),
        ("world", "handel", "no frame is called 'handel'.*handle"),
        ("chest", "handle", "nothing connects 'handle' with 'chest'"),
        ("world", "hand", "nothing connects 'hand' with 'world'.*hand: {parent"),
        ("chest", "world", "their roots are|Their roots are 'world' and 'chest'"),
    ],
)
def test_what_isnt_connected_is_refused_with_its_remedy(target: str, source: str, problem: str) -> None:
    """`lookup` of an earlier version answered as if all roots were one."""
    frames = Frames(
        {
            "world": FrameEntry(),
            "chest": FrameEntry(),
            "base": FrameEntry(parent="world"),
            "arm": FrameEntry(parent="base"),
            "tool": FrameEntry(parent="arm/flange"),
            "handle": FrameEntry(parent="tool"),
        },
        ("arm", "base", "hand"),
    )
    with pytest.raises(FrameError, match=problem):
        frames.path(target, source)
    assert frames.fixed(frames.path("arm/flange", "handle"))[:3] == (0, 0, 0)  # beyond the joints all is well


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"xyz": [0, 0, 1]}, "'xyz' is gone. It is called 'position'"),
        ({"quaternion": [1, 0, 0, 0], "rpy": [0, 0, 0]}, "either `quaternion` or `rpy`"),
        ({"quaternion": [0, 0, 0, 0]}, "length zero is no rotation"),
        ({"position": [0, float("nan"), 0]}, "finite"),
        ({"rpy": [0, float("inf"), 0]}, "finite"),
    ],
)
def test_a_placement_has_one_notation(options: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        Placement.model_validate(options)


@pytest.mark.parametrize(
    "pose", [[0.0] * 7, [0, 0, 0, np.nan, 0, 0, 0], [np.nan, 0, 0, 1, 0, 0, 0], [0, np.inf, 0], [0, 0, np.nan]]
)
def test_no_pose_is_no_transform(pose: list[float]) -> None:
    measured = np.array(pose, float)
    assert not is_pose(measured)
    assert np.isnan(as_pose(measured)).any() or not np.isfinite(as_pose(measured)).all()


def test_a_planar_pose_is_one_on_the_ground() -> None:
    assert rigid(as_pose(np.array([1.0, 2.0, 0.5]))).as_matrix() == pytest.approx(
        RigidTransform.from_components([1, 2, 0], Rotation.from_euler("z", 0.5)).as_matrix(), abs=1e-12
    )


def test_a_frame_of_an_older_recording_is_read() -> None:
    entry = FrameEntry.recorded({"parent": "a", "xyz": [1, 2, 3], "rpy": [0, 0, 0.5], "pose": None})
    assert entry.placed() == pytest.approx((1, 2, 3, *rotation.from_rpy(0, 0, 0.5)))
