"""Rotations against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from runtime.contracts import rotation

vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def scipys(q: rotation.Quaternion) -> Rotation:
    return Rotation.from_quat([*q[1:], q[0]])


@given(vectors, vectors)
def test_products_turns_and_matrices(a: rotation.Vector, b: rotation.Vector) -> None:
    p, q = rotation.exp(*a), rotation.exp(*b)
    np.testing.assert_allclose(rotation.matrix(p), Rotation.from_rotvec(a).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation.matrix(rotation.product(p, q)), (scipys(p) * scipys(q)).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation.turned(p, b), scipys(p).apply(b), atol=1e-12)
    back = rotation.from_matrix(rotation.matrix(p))
    assert abs(sum(x * y for x, y in zip(back, p, strict=True))) == pytest.approx(1, abs=1e-12)


@given(vectors, vectors)
def test_the_error_turns_the_actual_into_the_desired(a: rotation.Vector, b: rotation.Vector) -> None:
    desired, actual = rotation.exp(*a), rotation.exp(*b)
    turn = rotation.exp(*rotation.error(desired, actual))
    reached = rotation.product(turn, actual)
    assert abs(sum(x * y for x, y in zip(reached, desired, strict=True))) == pytest.approx(1, abs=1e-12)
    assert np.linalg.norm(rotation.error(desired, actual)) <= np.pi + 1e-9


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-6, 1.0, np.pi - 1e-9, np.pi])
def test_log_is_exps_inverse(angle: float) -> None:
    axis = np.array([1.0, -2.0, 2.0]) / 3
    np.testing.assert_allclose(rotation.log(rotation.exp(*(axis * angle))), axis * angle, atol=1e-9)


def test_nearer_keeps_a_quaternion_where_nothing_tells_which_is_nearer() -> None:
    q = (0.6, 0.0, 0.8, 0.0)
    assert rotation.nearer(q, (0.0, 0.0, 0.0, 0.0)) == q
    assert rotation.nearer(q, (float("nan"),) * 4) == q
    assert rotation.nearer(q, (-0.6, 0.0, -0.8, 0.0)) == (-0.6, 0.0, -0.8, 0.0)
