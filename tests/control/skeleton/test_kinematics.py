"""Node positions: against the files' reference, an independent reader, and Pinocchio's arm."""

import json

import numpy as np
import pytest
from helpers.shared import shared
from helpers.skeleton import FILES, FOLDER, ONE, THREE, TWO, human_srl, tip
from hypothesis import given
from hypothesis import strategies as st

from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.runtime.models.models import ArmsModel
from srl.runtime.models.skeleton import bvh

STILL = np.tile([1.0, 0.0, 0.0, 0.0], (59, 1))


def _rest(figure: HumanSrl) -> np.ndarray:
    return figure.human.offsets[list(figure.human.joints)]


@pytest.mark.parametrize("name", FILES)
def test_real_files_give_the_references_positions(name: str) -> None:
    path = shared(f"{FOLDER}/{name}")
    figure = HumanSrl(bvh.read_tree(path), ArmsModel().arms)
    kinematics = Kinematics(figure)
    turns, places = bvh.read(path).pose(figure.labels)
    for frame, nodes in json.loads(shared(f"{FOLDER}/reference_fk.json").read_text())[name].items():
        found = kinematics.nodes(turns[int(frame)], places[int(frame)], {})
        for node, expected in nodes.items():
            np.testing.assert_allclose(found[figure.tree.index(node)] * 100.0, expected, rtol=0, atol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_real_files_give_an_independent_readers_positions(name: str) -> None:
    bvhio = pytest.importorskip("bvhio")
    path = shared(f"{FOLDER}/{name}")
    figure = HumanSrl(bvh.read_tree(path), ArmsModel().arms)
    kinematics = Kinematics(figure)
    turns, places = bvh.read(path).pose(figure.labels)
    other = bvhio.readAsHierarchy(str(path))
    for frame in range(0, len(turns), max(1, len(turns) // 20)):
        other.loadPose(frame)
        found = kinematics.nodes(turns[frame], places[frame], {})
        for joint, _, _ in other.layout():
            # Its numbers have single precision.
            expected = np.array(joint.PositionWorld.to_tuple()) / 100.0
            np.testing.assert_allclose(found[figure.tree.index(joint.Name)], expected, rtol=0, atol=1e-5)


def test_all_zeros_give_the_t_pose() -> None:
    figure = human_srl()
    kinematics, tree = Kinematics(figure), figure.tree
    found = kinematics.rest()
    summed = np.zeros((len(tree), 3))
    for i, up in enumerate(tree.parents):
        summed[i] = tree.offsets[i] + (summed[up] if up >= 0 else 0.0)
    np.testing.assert_allclose(found, summed, rtol=0, atol=1e-12)
    arms = found[[tree.index(f"{side}{n}") for side in ("Left", "Right") for n in ("Arm", "ForeArm", "Hand")]]
    assert np.ptp(arms[:, 1]) < 1e-12 < 0.6 < arms[:, 0].max()  # level, to the sides
    np.testing.assert_allclose(found[tree.index("LeftFoot_End")][1], 0.0, rtol=0, atol=1e-9)  # on the floor


@pytest.mark.parametrize("q", [ONE, TWO, THREE])
def test_the_tip_is_where_pinocchio_puts_it(q: np.ndarray) -> None:
    _tip_agrees(q)


@given(st.lists(st.floats(-3, 3), min_size=7, max_size=7))
def test_the_tip_is_where_pinocchio_puts_it_anywhere(q: list[float]) -> None:
    _tip_agrees(np.array(q))


KINEMATICS = Kinematics(human_srl())


def _tip_agrees(q: np.ndarray) -> None:
    figure, kinematics = human_srl(), KINEMATICS
    found = kinematics.nodes(STILL, _rest(figure), {"right": q, "left": q})
    tree = figure.tree
    spine = found[tree.index("Spine")]
    np.testing.assert_allclose(found[tree.index("REnd")] - spine, tip(q), rtol=0, atol=1e-12)
    np.testing.assert_allclose((found[tree.index("LEnd")] - spine) * [-1, 1, 1], tip(q), rtol=0, atol=1e-12)


def test_configuration_two_points_forward_and_outward() -> None:
    figure = human_srl()
    kinematics = Kinematics(figure)
    end = figure.tree.index("REnd")
    one = kinematics.nodes(STILL, _rest(figure), {"right": ONE})[end].copy()
    two = kinematics.nodes(STILL, _rest(figure), {"right": TWO})[end]
    assert two[0] < one[0] - 0.2  # the body's right
    assert two[1] > one[1] + 0.1
    assert two[2] > one[2] + 0.1


def test_a_sliding_joint_moves_the_next_node_alone() -> None:
    figure = human_srl()
    kinematics, tree = Kinematics(figure), figure.tree
    before = kinematics.nodes(STILL, _rest(figure), {"right": ONE}).copy()
    moved = kinematics.nodes(STILL, _rest(figure), {"right": ONE + 0.1 * (np.arange(7) == 4)}) - before
    for name in tree.names:
        np.testing.assert_allclose(
            moved[tree.index(name)], [0.0, -0.1 * (name in ("RJ6", "RJ7", "REnd")), 0.0], rtol=0, atol=1e-12
        )


def test_the_arms_follow_the_spine() -> None:
    figure = human_srl()
    kinematics, tree = Kinematics(figure), figure.tree
    lean = STILL.copy()
    lean[figure.labels.index("Spine")] = np.cos(0.3), np.sin(0.3), 0.0, 0.0
    arm = figure.arm["right"]
    rest = kinematics.nodes(STILL, _rest(figure), {"right": TWO}).copy()
    bent = kinematics.nodes(lean, _rest(figure), {})
    spine = rest[tree.index("Spine")]
    c, s = np.cos(0.6), np.sin(0.6)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    np.testing.assert_allclose(bent[arm] - spine, (rest[arm] - spine) @ turn.T, rtol=0, atol=1e-12)


def test_shapes_join_the_same_model() -> None:
    figure = human_srl()

    def capsule(spec) -> None:
        import mujoco

        spec.body("RJ4").add_geom(name="elbow", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0.0, 0.0])

    kinematics = Kinematics(figure, capsule)
    found = kinematics.nodes(STILL, _rest(figure), {"right": TWO})
    np.testing.assert_allclose(kinematics.data.geom("elbow").xpos, found[figure.tree.index("RJ4")])
    assert kinematics.model.body(kinematics.body("RJ4")).name == "RJ4"
