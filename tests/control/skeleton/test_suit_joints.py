"""`suit-joints` and `suit-segments`: the one undoes the other; hidden segments; wrong options."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest
from helpers.control import bound
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.control.skeleton.human import human
from srl.control.skeleton.suit_joints import SuitJoints, SuitJointsConfig
from srl.control.skeleton.suit_segments import SuitSegments, SuitSegmentsConfig
from srl.testing import ControllerConformance

TREE = human()
JOINTS = [TREE.names[i] for i in TREE.joints]
BODY = [joint for joint in JOINTS if "Hand" not in joint or joint.endswith("Hand")]
SUIT_IN_ROOM = [0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5]  # y up, z ahead as z up, x ahead
MVN = {"quaternion": [0.5, 0.5, 0.5, 0.5]}


def joints(**options: Any) -> SuitJoints:
    config = SuitJointsConfig.model_validate({"segments": {joint.lower(): joint for joint in BODY}} | options)
    back = [0.0, 0.0, 0.0, 0.5, -0.5, -0.5, -0.5]
    return bound(SuitJoints("suit", config), frame=back)


def segments() -> SuitSegments:
    config = SuitSegmentsConfig(joints={joint.lower(): joint for joint in BODY}, frame="room")
    return bound(SuitSegments("segments", config), world=SUIT_IN_ROOM)


def posture(seed: int) -> tuple[Any, Any]:
    """Random turns of all joints but the fingers', with bones that stretch."""
    rng = np.random.default_rng(seed)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(JOINTS), 1))
    moved = [JOINTS.index(joint) for joint in BODY]
    turns[moved] = Rotation.random(len(moved), random_state=seed).as_quat(scalar_first=True)
    places = TREE.offsets[list(TREE.joints)].copy()
    places[moved] += rng.normal(0.0, 0.01, (len(moved), 3))
    return turns, places


def feed(law: SuitJoints, source: SuitSegments) -> None:
    law.input["pose"][:], law.input["visible"][:] = source.output["pose"], source.output["visible"]


def standing(seed: int = 1) -> tuple[SuitJoints, SuitSegments]:
    source, law = segments(), joints()
    source.input["rotation"][:], source.input["translation"][:] = posture(seed)
    source.reset()
    feed(law, source)
    law.reset()
    return law, source


class TestSuitJoints(ControllerConformance):
    def law(self) -> SuitJoints:
        return joints()

    inputs: ClassVar = {
        "pose": np.tile([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], (len(BODY), 1)),
        "visible": np.ones(len(BODY)),
    }


class TestSuitSegments(ControllerConformance):
    def law(self) -> SuitSegments:
        return segments()

    inputs: ClassVar = {"rotation": np.tile([1.0, 0.0, 0.0, 0.0], (59, 1)), "translation": np.zeros((59, 3))}


@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_segments_of_a_suit_make_the_same_suit(seed):
    law, source = standing(seed)
    np.testing.assert_allclose(law.output["translation"], source.input["translation"], atol=1e-12)
    same = np.abs(np.sum(law.output["rotation"] * source.input["rotation"], axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)


def test_segments_are_where_an_independent_library_has_them():
    _, source = standing(3)
    turns, places = posture(3)
    turn, place = Rotation.identity(), np.zeros(3)
    chain = ["RightHand"]
    while TREE.nodes[TREE.index(chain[-1])].parent:
        chain.append(TREE.nodes[TREE.index(chain[-1])].parent)
    for joint in reversed(chain):
        i = JOINTS.index(joint)
        place = place + turn.apply(places[i])
        turn = turn * Rotation.from_quat(turns[i], scalar_first=True)
    found = source.output["pose"][BODY.index("RightHand")]
    np.testing.assert_allclose(found[:3], place[[2, 0, 1]], atol=1e-12)


def test_axes_of_another_system_are_taken_off():
    """The same posture by segments whose axes are MVN's."""
    law, source = standing(4)
    other = joints(axes=MVN)
    feed(other, source)
    turned = Rotation.from_quat(source.output["pose"][:, 3:], scalar_first=True)
    mvn = turned * Rotation.from_quat(MVN["quaternion"], scalar_first=True).inv()
    other.input["pose"][:, 3:] = mvn.as_quat(scalar_first=True)
    other.reset()
    for name in ("rotation", "translation"):
        np.testing.assert_allclose(np.abs(other.output[name]), np.abs(law.output[name]), atol=1e-12)


def test_what_nothing_measures_has_the_standard_body_s_place():
    law = joints(segments={"pelvis": "Hips", "hand": "RightHand"}, scale=0.9)
    law.input["pose"][:] = [[0, 0, 1, 0.5, 0.5, 0.5, 0.5], [0.2, -0.4, 1.2, 0.5, 0.5, 0.5, 0.5]]
    law.input["visible"][:] = 1.0
    law.reset()
    spine = JOINTS.index("Spine")
    np.testing.assert_allclose(law.output["translation"][spine], 0.9 * TREE.offsets[TREE.index("Spine")])
    np.testing.assert_array_equal(law.output["rotation"][spine], [1, 0, 0, 0])


@pytest.mark.parametrize("wrong", [np.nan, 0.0, 2.0])
def test_a_hidden_segment_stays_in_its_parent_and_then_the_person_is_lost(wrong):
    law, source = standing(5)
    before = law.output["rotation"].copy()
    source.input["rotation"][:], source.input["translation"][:] = posture(6)
    source.update(0.01)
    feed(law, source)
    row = BODY.index("RightForeArm")
    if wrong == 0.0:
        law.input["visible"][row] = 0.0
    else:
        law.input["pose"][row, 3:] = wrong
    law.update(0.01)
    right, left = JOINTS.index("RightForeArm"), JOINTS.index("LeftForeArm")
    np.testing.assert_array_equal(law.output["rotation"][right], before[right])
    assert not np.allclose(law.output["rotation"][left], before[left])
    for _ in range(23):
        law.update(0.01)
        assert not law.lost
    for _ in range(2):
        law.update(0.01)
    assert law.lost
    assert law.metrics() == {"losses": 1}
    feed(law, source)
    law.update(0.01)
    assert not law.lost


def test_nothing_is_given_before_all_were_seen():
    law, source = standing(7)
    feed(law, source)
    law.input["visible"][0] = 0.0
    law.reset()
    assert np.isnan(law.output["rotation"]).all()
    assert np.isnan(law.output["translation"]).all()
    law.input["visible"][0] = 1.0
    law.update(0.01)
    assert np.isfinite(law.output["rotation"]).all()


def test_a_suit_without_a_pose_shows_nothing():
    source = segments()
    source.input["rotation"][:], source.input["translation"][:] = posture(1)
    source.input["rotation"][JOINTS.index("Spine")] = np.nan
    source.reset()
    np.testing.assert_array_equal(source.output["visible"], 0.0)


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        ({"a": "Hips", "b": "RightFoerArm"}, "no joint 'RightFoerArm'.*RightForeArm"),
        ({"a": "Hips", "b": "Hips"}, "two of them are 'Hips'"),
        ({"a": "Spine"}, "nothing is Hips"),
    ],
)
def test_wrong_options(chosen, said):
    with pytest.raises(ValidationError, match=said):
        SuitJointsConfig.model_validate({"segments": chosen})
