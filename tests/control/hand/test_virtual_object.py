"""Equations (1) to (4), their null space, their damping, and the finite similarity."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import FIST, HOME, RELAXED, finger_tip, hand_tips
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from srl.control.hand.sphere import MinimumSphere
from srl.control.hand.virtual_object import (
    Deformation,
    Psi,
    Similarity,
    VirtualObject,
    _any_rotation,
    _firm_rotation,
)
from srl.runtime.contracts.signals import Array

ISOTROPIC = VirtualObject(Deformation.ISOTROPIC, Psi.NONE, 4.0)
ROBOT = finger_tip(HOME)[None]
TIPS = hand_tips(RELAXED)

direction = arrays(float, 3, elements=st.floats(-1, 1))


def sphere_of(p_h: Array, p_a: Array = ROBOT) -> Array:
    return np.array(MinimumSphere().around(np.concatenate([p_h, p_a]).tolist()))


def skew(v: Array) -> Array:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def moved(model: VirtualObject, before: Array, after: Array, p_a: Array = ROBOT) -> Array:
    return model.move(before, after, p_a, sphere_of(before, p_a))


@given(direction, direction, st.floats(-0.5, 0.5), st.floats(0.7, 1.4))
def test_translation_rotation_and_scaling_carry_the_robotic_tip_exactly(
    shift: Array, axis: Array, turn: float, scale: float
) -> None:
    """Finite steps, about any centre: the midpoint makes each exact, far beyond 1e-6 of the motion."""
    assume(np.linalg.norm(axis) > 1e-3)
    R = Rotation.from_rotvec(turn * axis / np.linalg.norm(axis)).as_matrix()
    centre = 0.1 * axis
    for transform in (
        lambda p: p + 0.05 * shift,
        lambda p: (p - centre) @ R.T + centre,
        lambda p: scale * (p - centre) + centre,
    ):
        expected = transform(ROBOT)
        result = moved(ISOTROPIC, TIPS, transform(TIPS))
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-9 * np.abs(expected - ROBOT).max() + 1e-15)


def test_small_steps_solve_the_papers_equations() -> None:
    """Against (2) to (4) written out with a pseudo-inverse, for any motion of five, four or three tips."""
    rng = np.random.default_rng(4)
    undamped = VirtualObject(Deformation.ISOTROPIC, Psi.NONE, np.inf)
    for chosen in ([0, 1, 2, 3, 4], [0, 2, 3, 4], [0, 1, 4]):
        p_h, dp = TIPS[chosen], 1e-7 * rng.normal(size=(len(chosen), 3))
        o = sphere_of(p_h)[:3]
        A = np.concatenate([np.hstack([np.eye(3), -skew(p - o), (p - o)[:, None]]) for p in p_h])
        xi = np.linalg.pinv(A) @ dp.ravel()
        expected = xi[:3] + np.cross(xi[3:6], ROBOT - o) + xi[6] * (ROBOT - o)
        np.testing.assert_allclose(moved(undamped, p_h, p_h + dp) - ROBOT, expected, rtol=1e-4, atol=1e-12)


def test_two_points_minimum_norm() -> None:
    """A_rb has rank 5; psi minimum-norm is its pseudo-inverse with rotations scaled by r."""
    rigid = VirtualObject(Deformation.RIGID, Psi.MINIMUM_NORM, np.inf)
    rng, p_h = np.random.default_rng(5), TIPS[[2, 3]]
    *o, r = sphere_of(p_h)
    A = np.concatenate([np.hstack([np.eye(3), -skew(p - o) / r]) for p in p_h])
    assert np.linalg.matrix_rank(A) == 5
    for _ in range(10):
        dp = 1e-7 * rng.normal(size=(2, 3))
        xi = np.linalg.pinv(A, rcond=1e-9) @ dp.ravel()
        expected = xi[:3] + np.cross(xi[3:] / r, ROBOT - o)
        np.testing.assert_allclose(moved(rigid, p_h, p_h + dp) - ROBOT, expected, rtol=1e-3, atol=2e-12)


@given(direction)
def test_two_points_moved_alike_take_the_robotic_tip_along(shift: Array) -> None:
    """With psi none nothing turns about the line through both; the minimum norm would."""
    for n_h in (1, 2):
        rigid = VirtualObject(Deformation.RIGID, Psi.NONE, 4.0)
        result = moved(rigid, TIPS[:n_h], TIPS[:n_h] + 0.01 * shift)
        np.testing.assert_allclose(result, ROBOT + 0.01 * shift, atol=1e-12)


def test_maximised_scale_closes_on_a_single_finger() -> None:
    """One point: do, dPhi, ds are all open. Explained by scale, an approach is answered by an approach."""
    p_h, towards = TIPS[[2]], (ROBOT[0] - TIPS[2]) / np.linalg.norm(ROBOT[0] - TIPS[2])
    scale = VirtualObject(Deformation.ISOTROPIC, Psi.MAXIMISE_SCALE, 4.0)
    result = moved(scale, p_h, p_h + 1e-5 * towards)
    np.testing.assert_allclose(result - ROBOT, [-1e-5 * towards], rtol=1e-3, atol=1e-9)


def test_richer_deformations_carry_their_own_maps() -> None:
    rng = np.random.default_rng(6)
    points = TIPS + 0.02 * rng.normal(size=TIPS.shape)  # off the plane the fingertips lie near
    shear = 1e-6 * np.array([[3.0, 1, -2], [1, -2, 0.5], [-2, 0.5, 1]])
    for deformation, G in ((Deformation.NON_ISOTROPIC, np.diag(np.diag(shear))), (Deformation.SHEAR, shear)):
        model = VirtualObject(deformation, Psi.NONE, np.inf)
        M = G + skew(1e-6 * rng.normal(size=3))
        result = moved(model, points, points @ (np.eye(3) + M).T)
        np.testing.assert_allclose(result - ROBOT, ROBOT @ M.T, rtol=1e-4, atol=1e-11)


@pytest.mark.parametrize("deformation", Deformation)
@pytest.mark.parametrize("psi", Psi)
@pytest.mark.parametrize("n_h", [1, 2, 3, 5])
def test_degenerate_points_stay_finite_and_bounded(deformation: Deformation, psi: Psi, n_h: int) -> None:
    """Coincident, collinear, coinciding with the robotic tip, jumping: never NaN, never beyond 4 hands."""
    rng = np.random.default_rng(n_h)
    line = np.linspace(0, 0.05, n_h)[:, None] * [[1.0, 2, 0]]
    for before in (
        np.zeros((n_h, 3)),
        line,
        line + 1e-9 * rng.normal(size=(n_h, 3)),
        np.tile(ROBOT, (n_h, 1)),
    ):
        for size in (0.0, 1e-9, 1e-3, 0.1, 10.0):
            model = VirtualObject(deformation, psi, 4.0)
            result = moved(model, before, before + size * rng.normal(size=(n_h, 3)))
            assert np.all(np.isfinite(result))
            assert np.abs(result - ROBOT).max() < 0.5 + 20.0 * size


@pytest.mark.slow
def test_noise_gain_is_what_noise_does() -> None:
    rng = np.random.default_rng(7)
    for chosen in ([0, 1, 2, 3, 4], [2, 3, 4]):
        p_h = TIPS[chosen]
        noise = 1e-6 * rng.normal(size=(2000, len(chosen), 3))
        out = np.array([moved(ISOTROPIC, p_h, p_h + dp) - ROBOT for dp in noise])
        gain, _ = ISOTROPIC.noise_gain(p_h, ROBOT)
        assert np.sqrt((out**2).mean() / (noise**2).mean()) == pytest.approx(gain, rel=0.05)


def test_damping_tames_the_partial_mapping_and_leaves_the_whole_hand() -> None:
    for u in np.linspace(0.0, 0.8, 9):
        tips = hand_tips(RELAXED + u * (FIST - RELAXED))
        damped, undamped = ISOTROPIC.noise_gain(tips, ROBOT)
        assert damped == undamped < 2.5
        damped, undamped = ISOTROPIC.noise_gain(tips[2:], ROBOT)
        assert damped < 4.5
        assert damped <= undamped
        for none in (np.inf, 1e200):  # whose square is no number
            assert VirtualObject(Deformation.ISOTROPIC, Psi.NONE, none).noise_gain(tips[2:], ROBOT)[0] == undamped


def test_a_nearly_straight_set_is_damped_continuously() -> None:
    """As three points close on a line the answer to the same motion changes gradually and then fades."""
    dp = 1e-6 * np.array([[0.0, 0, 1], [0, 0, -2], [0, 0, 1]])
    turns = []
    for height in np.linspace(0.02, 0.0, 200):
        p_h = np.array([[-0.02, 0.1, -0.02], [0.0, 0.1 + height, -0.02], [0.02, 0.1, -0.02]])
        turns.append(np.linalg.norm(moved(ISOTROPIC, p_h, p_h + dp) - ROBOT))
    assert np.abs(np.diff(turns)).max() < 0.1 * max(turns)
    assert turns[-1] < 0.01 * max(turns)


@pytest.mark.parametrize("deformation", [Deformation.ISOTROPIC, Deformation.RIGID])
def test_the_closed_form_is_the_general_solution(deformation: Deformation) -> None:
    """One and two robotic tips, gain limits that damp some of the steps; steps beyond the bound, too."""
    rng, closed = np.random.default_rng(9), 0
    for k in range(600):
        model = VirtualObject(deformation, Psi.NONE, [1.5, 4.0, np.inf][k % 3])
        before = TIPS[: rng.integers(3, 6)] + 0.01 * rng.normal(size=3)
        dp = rng.choice([1e-5, 1e-2, 1.0]) * rng.normal(size=before.shape)
        tips = ROBOT + 0.03 * rng.normal(size=(rng.integers(1, 3), 3))
        mid = before + 0.5 * dp
        c, v = mid.mean(axis=0), dp.mean(axis=0)
        fast = model._move_similarly((mid - c).tolist(), dp.tolist(), tuple(c.tolist()), tuple(v.tolist()), tips)
        general = model._move_generally(mid, dp, c, v, tips, np.zeros(4))
        if fast is not None:
            closed += 1
            np.testing.assert_allclose(fast, general, rtol=1e-9, atol=1e-13)
    assert 200 < closed < 550


def test_the_closed_rotation_is_the_quaternions() -> None:
    """Planar, mirrored and general K; the closed form declines only where the turn is hardly held."""
    rng, declined = np.random.default_rng(10), 0
    for _ in range(500):
        s = np.sort(rng.uniform(0, 1, 3))[::-1] * [1, 1, rng.choice([-1, 0, 1e-6, 1])] * 10.0 ** rng.uniform(-5, 0)
        U, V = Rotation.random(2, random_state=rng).as_matrix()
        K = (U @ np.diag(s) @ V.T).tolist()
        found = _firm_rotation(K)
        if found is None:
            declined += 1
            assert s[1] + s[2] < 0.75 * s[0] or s[2] < 0
            continue
        np.testing.assert_allclose(found[0], U @ V.T, atol=1e-13)
        assert found[1] == pytest.approx(s.sum(), rel=1e-13)
        np.testing.assert_allclose(_any_rotation(K)[0], found[0], atol=1e-9)
    assert declined < 250


@given(direction, direction, st.floats(0.5, 2.0))
def test_similarity_is_exact_and_agrees_with_scipy(shift: Array, turn: Array, scale: float) -> None:
    R = Rotation.from_rotvec(2.0 * turn)
    result = Similarity(TIPS, rigid=False).carry(scale * R.apply(TIPS) + shift, ROBOT)
    np.testing.assert_allclose(result, scale * R.apply(ROBOT) + shift, atol=1e-9)


def test_similarity_of_unlike_hands_is_the_least_squares_one() -> None:
    fist, rng = hand_tips(0.5 * (FIST + RELAXED)), np.random.default_rng(8)
    for _ in range(20):
        b = fist + 0.005 * rng.normal(size=(5, 3))
        R, _ = Rotation.align_vectors(b - b.mean(axis=0), TIPS - TIPS.mean(axis=0))
        rotated = R.apply(ROBOT - TIPS.mean(axis=0))
        np.testing.assert_allclose(Similarity(TIPS, rigid=True).carry(b, ROBOT), b.mean(axis=0) + rotated, atol=1e-7)


def test_similarity_of_straight_sets_does_not_flip() -> None:
    """Where the middle of three points crosses their line, least squares alone would turn by 180 degrees."""

    def bent(height: float) -> Array:
        return np.array([[-0.02, 0.1, -0.02], [0.0, 0.1 + height, -0.02], [0.02, 0.1, -0.02]])

    ways = [Similarity(bent(0.004), rigid=False).carry(bent(h), ROBOT)[0] for h in np.linspace(0.008, -0.008, 400)]
    assert np.linalg.norm(np.diff(ways, axis=0), axis=1).max() < 0.005
