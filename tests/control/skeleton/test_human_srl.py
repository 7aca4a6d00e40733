"""The trees: counts, order, names, mirror."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.skeleton import human_srl
from hypothesis import given
from hypothesis import strategies as st

from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.errors import OptionError
from srl.runtime.models.models import ArmJointEntry, ArmsModel
from srl.runtime.models.skeleton.tree import Node, Tree

FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")


def _arm(side: str) -> list[str]:
    names = [f"{side}{n}" for n in ("Shoulder", "Arm", "ForeArm", "Hand")]
    for finger in FINGERS:
        names += [] if finger == "Thumb" else [f"{side}InHand{finger}"]
        names += [f"{side}Hand{finger}{n}" for n in ("1", "2", "3", "3_End")]
    return names


def test_ninety_nodes_in_the_papers_order() -> None:
    tree = human_srl().tree
    expected = [
        "Hips",
        *("RightUpLeg", "RightLeg", "RightFoot", "RightFoot_End"),
        *("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftFoot_End"),
        "Spine",
        *("RBase", "RJ1", "RJ2", "RJ3", "RJ4", "RJ5", "RJ6", "RJ7", "REnd"),
        *("LBase", "LJ1", "LJ2", "LJ3", "LJ4", "LJ5", "LJ6", "LJ7", "LEnd"),
        *("Spine1", "Spine2", "Spine3", "Neck", "Head", "Head_End"),
        *_arm("Right"),
        *_arm("Left"),
    ]
    assert list(tree.names) == expected
    assert (len(tree), len(tree.segments)) == (90, 89)
    assert tree.parents[tree.index("RBase")] == tree.parents[tree.index("LBase")] == tree.index("Spine")
    for name in ("RJ1", "RJ7", "REnd", "LEnd", "Spine1"):
        assert tree.parents[tree.index(name)] == tree.index(
            {"RJ1": "RBase", "Spine1": "Spine"}.get(name, tree.names[tree.index(name) - 1])
        )


def test_the_human_has_the_suits_joints_and_thirteen_ends() -> None:
    tree, suit = human(), Skeleton("axis-neuron")
    assert (len(tree), len(tree.segments), len(tree.joints)) == (72, 71, 59)
    assert tuple(tree.names[i] for i in tree.joints) == suit.names == human_srl().labels
    parents = {tree.names[i]: tree.names[tree.parents[i]] for i in tree.joints[1:]}
    assert parents == {name: suit.names[up] for name, up in zip(suit.names[1:], suit.parents[1:], strict=True)}
    assert tree.offsets[0].tolist() == pytest.approx([0.0, 0.95729, 0.0])  # the paper's table 1


def test_the_hip_has_the_papers_children() -> None:
    tree = human()
    assert [child + 1 for child in tree.children(0)] == [2, 6, 10]  # table 1, which counts from 1


def test_every_segment_is_drawn_once() -> None:
    tree = human_srl().tree
    drawn = [tuple(sorted(pair)) for line in tree.polylines for pair in pairwise(line)]
    assert sorted(drawn) == sorted(tuple(sorted(pair)) for pair in tree.segments)


@given(st.lists(st.floats(-3, 3), min_size=7, max_size=7))
def test_the_left_arm_is_the_right_one_in_a_mirror(q: list[float]) -> None:
    figure = human_srl()
    still = np.tile([1.0, 0.0, 0.0, 0.0], (1, 59, 1))
    places = np.zeros((1, 59, 3))
    angles = np.array([q])
    turns, offsets = figure.whole(still, places, {"right": angles, "left": angles})
    right, left = figure.arm["right"], figure.arm["left"]
    np.testing.assert_array_equal(offsets[0, left] * [-1, 1, 1], offsets[0, right])
    np.testing.assert_array_equal(turns[0, left] * [1, 1, -1, -1], turns[0, right])


def test_arms_on_a_node_that_isnt_there_are_refused() -> None:
    with pytest.raises(OptionError, match=r"no node 'Spin'.*Did you mean 'Spine'"):
        HumanSrl(human(), ArmsModel(parent="Spin").arms)


@pytest.mark.parametrize(
    ("nodes", "fault"),
    [
        ([("a", ""), ("a", "a")], "two nodes are called 'a'"),
        ([("a", ""), ("b", "")], "second root"),
        ([("a", ""), ("b", "c"), ("c", "a")], "before its parent"),
        ([("a", ""), ("b", "a"), ("c", "a"), ("d", "b")], "doesn't follow the branch"),
    ],
)
def test_a_tree_out_of_order_is_refused(nodes: list[tuple[str, str]], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        Tree(Node(name, up, (0.0, 0.0, 0.0)) for name, up in nodes)


def test_any_body_may_wear_them() -> None:
    body = Tree(
        [
            Node("pelvis", "", (0.0, 0.9, 0.0)),
            Node("thigh", "pelvis", (0.1, 0.0, 0.0)),
            Node("knee", "thigh", (0.0, -0.4, 0.0), end=True),
            Node("chest", "pelvis", (0.0, 0.4, 0.0)),
            Node("head", "chest", (0.0, 0.3, 0.0), end=True),
        ]
    )
    two = (ArmJointEntry(at=(-0.1, 0.0, 0.0), axis="y"), ArmJointEntry(at=(0.0, -0.2, 0.0), axis="-y", slides=True))
    model = ArmsModel(sides=("right", "left"), parent="chest", base=(0.0, 0.0, 0.1), joints=two)
    figure = HumanSrl(body, model.arms)
    assert figure.tree.names[3:12] == ("chest", "RBase", "RJ1", "RJ2", "REnd", "LBase", "LJ1", "LJ2", "LEnd")
    turns, places = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), body.offsets[list(body.joints)]
    q = np.array([np.pi / 2, 0.05])
    nodes = Kinematics(figure).nodes(turns, places, {"right": q, "left": q})
    # The slide is the last joint, so it moves the end; the arm's other nodes hang below each other.
    for side, sign in (("R", -1.0), ("L", 1.0)):
        expected = [[0.1 * sign, 1.3, 0.1], [0.1 * sign, 1.1, 0.1], [0.1 * sign, 1.1 - 0.08 - 0.05, 0.1]]
        found = nodes[[figure.tree.index(side + name) for name in ("J1", "J2", "End")]]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(nodes[figure.tree.index("head")], [0.0, 1.6, 0.0], rtol=0, atol=1e-12)
