"""The tree of frames, against scipy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from runtime.contracts.errors import ProfileError
from runtime.contracts.frames import FrameEntry, Frames
from runtime.contracts.rotation import from_pose

numbers = st.floats(-3.0, 3.0)
triples = st.tuples(numbers, numbers, numbers)


@given(xyz=triples, rpy=triples)
def test_a_fixed_transform_is_yaw_after_pitch_after_roll(
    xyz: tuple[float, float, float], rpy: tuple[float, float, float]
) -> None:
    T = FrameEntry(xyz=xyz, rpy=rpy).fixed()
    assert T[:3, :3] == pytest.approx(Rotation.from_euler("xyz", rpy).as_matrix(), abs=1e-12)
    assert T[:3, 3] == pytest.approx(xyz)


@given(q=st.tuples(numbers, numbers, numbers, numbers).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_a_pose_is_position_and_quaternion_w_first(q: tuple[float, float, float, float]) -> None:
    T = from_pose(np.array([1.0, 2.0, 3.0, *q]))
    assert T[:3, :3] == pytest.approx(Rotation.from_quat(q, scalar_first=True).as_matrix(), abs=1e-12)


@given(a=triples, b=triples, p=triples)
def test_a_point_goes_through_the_tree_and_back(
    a: tuple[float, float, float], b: tuple[float, float, float], p: tuple[float, float, float]
) -> None:
    """world <- chest (fixed) <- hand (measured); tool hangs on the world."""
    frames = Frames(
        {
            "world": FrameEntry(),
            "chest": FrameEntry(parent="world", xyz=a, rpy=b),
            "hand": FrameEntry(parent="chest", xyz=(0.1, 0.0, 0.0), pose="mocap.hand"),
            "tool": FrameEntry(parent="world", xyz=b, rpy=a),
        },
        "test",
    )
    pose = np.array([0.3, -0.2, 0.5, *Rotation.from_euler("xyz", p).as_quat(scalar_first=True)])
    frames.bind({"mocap.hand": pose})
    chest, tool = Rotation.from_euler("xyz", b), Rotation.from_euler("xyz", a)
    point = np.array(p)
    in_chest = Rotation.from_euler("xyz", p).apply(point) + pose[:3] + [0.1, 0.0, 0.0]
    in_tool = tool.inv().apply(chest.apply(in_chest) + a - np.array(b))
    assert (frames.lookup("tool", "hand") @ [*point, 1.0])[:3] == pytest.approx(in_tool, abs=1e-9)
    assert frames.lookup("hand", "tool") @ frames.lookup("tool", "hand") == pytest.approx(np.eye(4), abs=1e-9)
    pose[:3] += 1.0  # measured anew: the next look-up has it
    assert frames.lookup("chest", "hand")[:3, 3] == pytest.approx(np.array([0.4, -0.2, 0.5]) + 1.0)


def test_circles_and_orphans_are_refused() -> None:
    with pytest.raises(ProfileError, match="circle"):
        Frames({"a": FrameEntry(parent="b"), "b": FrameEntry(parent="a")}, "test")
    with pytest.raises(ProfileError, match="chst"):
        Frames({"hand": FrameEntry(parent="chst"), "chest": FrameEntry()}, "test")
