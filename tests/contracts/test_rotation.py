"""Rotations against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.runtime.contracts import rotation

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


@given(vectors.filter(lambda v: np.linalg.norm(v) > 1e-3), st.floats(0.0, 6.2))
def test_the_nearest_log_goes_on_beyond_pi_without_a_jump(direction: rotation.Vector, last: float) -> None:
    axis = np.array(direction) / np.linalg.norm(direction)
    found: rotation.Vector = (0.0, 0.0, 0.0)
    for angle in [*np.linspace(0.0, last, 20), *np.linspace(last, 0.0, 20)]:
        found = rotation.log_nearest(rotation.exp(*(angle * axis)), found)
        assert np.abs(found - angle * axis).max() < 1e-7


@given(vectors, st.tuples(*[st.floats(-9.0, 9.0)] * 3))
def test_the_nearest_log_is_a_log_and_none_is_nearer(v: rotation.Vector, to: rotation.Vector) -> None:
    q = rotation.exp(*v)
    found = np.array(rotation.log_nearest(q, to))
    assert scipys(q).approx_equal(Rotation.from_rotvec(found), atol=1e-7)
    size = np.linalg.norm(found)
    if size > 1e-6:
        for turn in (-2 * np.pi, 2 * np.pi):
            assert np.linalg.norm(found - to) <= np.linalg.norm(found * (1 + turn / size) - to) + 1e-6


@pytest.mark.parametrize("to", [(0.0, 0.0, 0.0), (0.0, 6.0, 0.0), (0.0, -6.5, 0.1)])
def test_the_identity_s_nearest_log_is_none_or_a_full_turn(to: rotation.Vector) -> None:
    found = np.linalg.norm(rotation.log_nearest((1.0, 0.0, 0.0, 0.0), to))
    assert found == pytest.approx(2 * np.pi if any(to) else 0.0)


def test_the_nearest_log_starts_again_where_nothing_is_known() -> None:
    q, unknown = rotation.exp(0.0, 3.0, 0.0), (float("nan"),) * 3
    assert rotation.log_nearest(q, unknown) == rotation.log(q)
    assert rotation.log_nearest((1.0, 0.0, 0.0, 0.0), unknown) == (0.0, 0.0, 0.0)
    assert np.isnan(rotation.log_nearest((float("nan"),) * 4, (0.0, 0.0, 0.0))).all()


def test_nearer_keeps_a_quaternion_where_nothing_tells_which_is_nearer() -> None:
    q = (0.6, 0.0, 0.8, 0.0)
    assert rotation.nearer(q, (0.0, 0.0, 0.0, 0.0)) == q
    assert rotation.nearer(q, (float("nan"),) * 4) == q
    assert rotation.nearer(q, (-0.6, 0.0, -0.8, 0.0)) == (-0.6, 0.0, -0.8, 0.0)


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
@pytest.mark.parametrize("second", [0.0, -1.2, 0.5 * np.pi, -0.5 * np.pi])
def test_one_matrix_has_the_euler_angles_of_many(order: rotation.Order, second: float) -> None:
    R = Rotation.from_euler(order, [0.3, second, -2.0]).as_matrix()
    one = rotation.euler(R, order)
    assert one == pytest.approx(rotation.euler_angles(R[None], order)[0].tolist(), abs=1e-15)
    assert Rotation.from_euler(order, one).as_matrix() == pytest.approx(R, abs=1e-7)
