"""BVH: written files read back, by an independent library, too; any channels; a skeleton without motion."""

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from helpers.shared import shared
from helpers.skeleton import FOLDER, THREE, TWO, human_srl

from srl.control.skeleton.kinematics import Kinematics
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.rotation import Order, matrices
from srl.runtime.models.skeleton import bvh


@pytest.mark.parametrize("order", get_args(Order))
def test_what_is_written_is_read_back(order: Order, tmp_path: Path) -> None:
    figure = human_srl()
    random = np.random.default_rng(1)
    turns = random.normal(size=(3, 90, 4))
    turns /= np.linalg.norm(turns, axis=2)[:, :, None]
    places = random.normal(size=(3, 90, 3))
    bvh.write(tmp_path / "a.bvh", figure.tree, turns, places, 1 / 60, order)
    file = bvh.read(tmp_path / "a.bvh")
    joints = list(figure.tree.joints)
    found = file.pose([figure.tree.names[i] for i in joints])
    np.testing.assert_allclose(
        matrices(found[0].reshape(-1, 4)), matrices(turns[:, joints].reshape(-1, 4)), rtol=0, atol=1e-8
    )
    np.testing.assert_allclose(found[1], places[:, joints], rtol=0, atol=1e-9)
    assert file.frame_time == pytest.approx(1 / 60, rel=1e-8)
    np.testing.assert_allclose(file.tree().offsets, figure.tree.offsets, rtol=0, atol=1e-9)


def test_an_independent_reader_finds_the_arm_where_it_is(tmp_path: Path) -> None:
    bvhio = pytest.importorskip("bvhio")
    figure = human_srl()
    file = bvh.read(shared(f"{FOLDER}/fullbody_walk_yxz.bvh"))
    turns, places = file.pose(figure.labels)
    arms = {"right": np.linspace(TWO, THREE, len(turns)), "left": np.linspace(THREE, TWO, len(turns))}
    bvh.write(tmp_path / "a.bvh", figure.tree, *figure.whole(turns, places, arms), file.frame_time)
    other = bvhio.readAsHierarchy(str(tmp_path / "a.bvh"))
    kinematics = Kinematics(figure)
    for frame in range(0, len(turns), 30):
        found = kinematics.nodes(turns[frame], places[frame], {side: q[frame] for side, q in arms.items()})
        other.loadPose(frame)
        seen = {joint.Name: joint for joint, _, _ in other.layout()}
        for name in (figure.tree.names[i] for i in figure.tree.joints):
            expected = np.array(seen[name].PositionWorld.to_tuple()) / 100.0
            np.testing.assert_allclose(found[figure.tree.index(name)], expected, rtol=0, atol=1e-5)


def test_a_skeleton_without_motion_is_a_tree(tmp_path: Path) -> None:
    text = shared(f"{FOLDER}/fullbody_xyz.bvh").read_text()
    (tmp_path / "a.bvh").write_text(text[: text.index("MOTION")])
    tree = bvh.read_tree(tmp_path / "a.bvh")
    assert (len(tree), len(tree.joints)) == (72, 59)
    with pytest.raises(RecordingError, match="the file ends"):
        bvh.read(tmp_path / "a.bvh")


ODD = """HIERARCHY
ROOT hip
{
  OFFSET 0 90 0
  CHANNELS 4 Zrotation Yposition Xrotation Zrotation
  JOINT knee
  {
    OFFSET 0 -40 0
    CHANNELS 1 Xrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0166667
90 80 90 -90 90
0 85 0 0 0
"""


def test_channels_may_have_any_order_and_number(tmp_path: Path) -> None:
    (tmp_path / "a.bvh").write_text(ODD)
    file = bvh.read(tmp_path / "a.bvh")
    turns, places = file.pose(["hip", "knee"])
    np.testing.assert_allclose(places[0, 0], [0.0, 0.8, 0.0])  # a channel replaces OFFSET, others keep theirs
    for i in range(2):
        np.testing.assert_allclose(matrices(turns[:, i]), file.rotation(i), rtol=0, atol=1e-12)
    # Rz(90) Rx(90) Rz(-90) = Ry(90)
    np.testing.assert_allclose(matrices(turns[:1, 0])[0] @ [0, 0, 1], [1, 0, 0], rtol=0, atol=1e-12)
