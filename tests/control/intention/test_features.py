"""Features of motion: what they don't depend on, and that one sample is described as many are."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.intention import JOINTS, SKELETON, session
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.intention.features import FEATURES, FRAME, FRAMES, POSTURE, features, frame, frames
from srl.runtime.contracts.rotation import matrices, product
from srl.runtime.contracts.signals import Array

AT = 100  # a sample in the middle of an action


def window(rotation: Array, translation: Array) -> Array:
    return features(frames(rotation[AT : AT + FRAMES], translation[AT : AT + FRAMES]))


def turned(rotation: Array, translation: Array, angle: float, place: Array) -> tuple[Array, Array]:
    """The same motion of a person who stands at `place` (x, z) and faces elsewhere."""
    q, p = rotation.copy(), translation.copy()
    turn = (np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0)
    q[:, 0] = [product(turn, tuple(row)) for row in q[:, 0]]
    R = matrices(np.array([turn]))[0]
    p[:, 0] = p[:, 0] @ R.T + [place[0], 0.0, place[1]]
    return q, p


@given(st.floats(-np.pi, np.pi), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
@settings(max_examples=25, deadline=None)
def test_they_dont_depend_on_where_the_person_stands_or_faces(angle: float, x: float, z: float) -> None:
    made = session(1)
    found = window(*turned(made.rotation, made.translation, angle, np.array([x, z])))
    np.testing.assert_allclose(found, window(made.rotation, made.translation), atol=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_a_quaternions_sign_means_nothing(seed: int) -> None:
    made = session(1)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], made.rotation.shape[:2])[..., None]
    found = window(signs * made.rotation, made.translation)
    assert found.tolist() == window(made.rotation, made.translation).tolist()


@given(st.floats(0.5, 2.0))
@settings(max_examples=10, deadline=None)
def test_size_alone_changes_nothing(size: float) -> None:
    made = session(1)
    found = window(made.rotation, size * made.translation)
    np.testing.assert_allclose(found, window(made.rotation, made.translation), atol=1e-6)


def test_one_sample_is_described_as_many_are() -> None:
    made = session(2)
    many = frames(made.rotation[:50], made.translation[:50])
    assert many.shape == (50, FRAME)
    for row, q, p in zip(many, made.rotation, made.translation, strict=False):
        np.testing.assert_allclose(frame(q.tolist(), p.tolist()), row, atol=1e-12)


def test_directions_are_those_of_the_whole_skeletons_kinematics() -> None:
    """The oracle goes from joint to joint through the whole tree with matrices, as no feature does."""
    rng = np.random.default_rng(3)
    q = rng.normal(size=(59, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    R, p = np.empty((59, 3, 3)), np.empty((59, 3))
    for i, (parent, own) in enumerate(zip(SKELETON.parents, matrices(q), strict=True)):
        up = R[parent] if parent >= 0 else np.eye(3)
        R[i] = up @ own
        p[i] = (p[parent] if parent >= 0 else 0.0) + up @ SKELETON.offsets[i]
    found = np.array(frame(q[JOINTS].tolist(), SKELETON.offsets[JOINTS].tolist()))
    at = SKELETON.names.index
    chest, hips = R[at("Spine3")], R[at("Hips")]
    np.testing.assert_allclose(found[:3], hips.T @ [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(found[3:6], chest.T @ [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(found[6:9], hips.T @ chest @ [0, 0, 1], atol=1e-12)
    row = 9
    for side in ("Left", "Right"):
        for base, a, b in ((chest, "Arm", "ForeArm"), (chest, "ForeArm", "Hand"), (hips, "UpLeg", "Leg"),
                           (hips, "Leg", "Foot")):  # fmt: skip
            bone = p[at(side + b)] - p[at(side + a)]
            np.testing.assert_allclose(found[row : row + 3], base.T @ bone / np.linalg.norm(bone), atol=1e-8)
            row += 3
    assert row == POSTURE


def test_mean_trend_spread_and_way() -> None:
    made = np.zeros((FRAMES, FRAME))
    ramp = np.linspace(-1.0, 1.0, FRAMES)
    made[:, 0] = 0.5 + 0.25 * ramp
    made[:, 1] = 0.3 * (-1.0) ** np.arange(FRAMES)
    made[:, POSTURE] = np.linspace(2.0, 4.0, FRAMES)  # 2 leg lengths to x
    made[:, POSTURE + 3] = 1.0  # and it faces x, so that is forward
    found = features(made)
    assert found.shape == (FEATURES,)
    assert found[0] == pytest.approx(0.5)
    assert found[POSTURE] == pytest.approx(0.5)  # twice 0.25
    assert found[2 * POSTURE] == pytest.approx(0.01, abs=1e-3)  # what is left is the floor
    assert found[2 * POSTURE + 1] == pytest.approx(0.3, abs=0.01)
    np.testing.assert_allclose(found[-3:], [2.0, 0.0, 0.0], atol=1e-9)
