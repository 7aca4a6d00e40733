"""A frame in its parent from points and poses: exact without noise, as another method finds it, or refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.commissioning.calibration.frames.exchanged import exchanged
from srl.commissioning.calibration.frames.fit import Mount, MountError, Thresholds, axes, fit, hand_eye, refusals, rigid
from srl.runtime.contracts.signals import Array

LIMITS = Thresholds()
seeds = st.integers(0, 10_000)


def pose(random: np.random.Generator, far: float = 2.0) -> Array:
    turn = Rotation.random(rng=random).as_quat(scalar_first=True)
    return np.array([*random.uniform(-far, far, 3), *turn])


def T(pose: Array) -> Array:
    made = np.eye(4)
    made[:3, :3] = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()
    made[:3, 3] = pose[:3]
    return made


def as_pose(T: Array) -> Array:
    return np.array([*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True, scalar_first=True)])


def points(seed: int = 3, n: int = 8, noise: float = 0.0) -> tuple[Array, Array, Array]:
    """The frame's pose (7,), and the points (n, 3) in the parent and in the frame."""
    random = np.random.default_rng(seed)
    Y, own = pose(random), random.uniform(-1.0, 1.0, (n, 3))
    seen = own @ T(Y)[:3, :3].T + Y[:3]
    return Y, seen + noise * random.normal(size=(n, 3)), own


def poses(seed: int = 1, n: int = 8, noise: float = 0.0) -> tuple[Array, Array, Array, Array]:
    """Frame (7,) in the parent, second body (7,) in the first, and the poses (n, 7) in parent and frame."""
    random = np.random.default_rng(seed)
    Y, X, B = pose(random), pose(random, 0.1), [pose(random, 0.5) for _ in range(n)]
    A = np.array([as_pose(T(Y) @ T(b) @ np.linalg.inv(T(X))) for b in B])
    A[:, :3] += noise * random.normal(size=(n, 3))
    turned = Rotation.from_rotvec(noise / LIMITS.lever * random.normal(size=(n, 3)))
    A[:, 3:] = (Rotation.from_quat(A[:, 3:], scalar_first=True) * turned).as_quat(scalar_first=True)
    return Y, X, A, np.array(B)


def of_points(seen: Array, own: Array, noise: float = 0.0) -> Mount:
    return fit("points", range(1, len(own) + 1), seen, own, noise, LIMITS)


def of_poses(A: Array, B: Array, noise: float = 0.0) -> Mount:
    return fit("poses", range(1, len(B) + 1), A, B, noise, LIMITS)


def apart(one: Array, other: Array) -> tuple[float, float]:
    """m, rad between two poses."""
    turns = [Rotation.from_quat(each[3:], scalar_first=True) for each in (one, other)]
    return float(np.linalg.norm(one[:3] - other[:3])), float((turns[0].inv() * turns[1]).magnitude())


@settings(deadline=None, max_examples=50)
@given(seeds, st.integers(4, 12))
def test_points_without_noise_give_the_frame_exactly(seed: int, n: int) -> None:
    Y, seen, own = points(seed, n)
    try:
        found = of_points(seen, own)
    except MountError as error:
        assert "it is like point" in error.problem or "near a line" in error.problem  # noqa: PT017
        return
    assert max(apart(found.pose, Y)) < 1e-6
    assert max(found.left.max(), found.without.max(), *found.uncertain) < 1e-6
    assert refusals(found, LIMITS) == ()


@settings(deadline=None, max_examples=50)
@given(seeds, st.integers(3, 12), st.floats(0.0, 0.2))
def test_the_rotation_of_points_is_scipys(seed: int, n: int, noise: float) -> None:
    _, seen, own = points(seed, n, noise)
    R, t = rigid(seen, own)
    other, left = Rotation.align_vectors(seen - seen.mean(axis=0), own - own.mean(axis=0))
    np.testing.assert_allclose(np.linalg.norm(seen - own @ R.T - t), left, atol=1e-6)
    if n > 3:
        np.testing.assert_allclose(R, other.as_matrix(), atol=1e-5)
    assert np.linalg.det(R) == pytest.approx(1.0)


@settings(deadline=None, max_examples=15)
@given(seeds, st.integers(6, 12))
def test_poses_without_noise_give_frame_and_body_exactly(seed: int, n: int) -> None:
    Y, X, A, B = poses(seed, n)
    try:
        found = of_poses(A, B)
    except MountError as error:
        assert "it is like pose" in error.problem  # noqa: PT017
        return
    assert max(apart(found.pose, Y)) < 1e-6
    assert found.body is not None
    assert max(apart(found.body, as_pose(np.linalg.inv(T(X))))) < 1e-6
    assert max(found.left.max(), found.askew.max(), found.without.max()) < 1e-6


@settings(deadline=None, max_examples=30)
@given(seeds)
def test_the_closed_form_is_that_of_park_and_martin(seed: int) -> None:
    """They solve A X = X B of motions between poses (1994, eq. 20, 22): the body alone, without the frame."""
    _, _, A, B = poses(seed, 10)
    motions = [
        (T(a0) @ np.linalg.inv(T(a1)), T(b0) @ np.linalg.inv(T(b1)))
        for (a0, a1), (b0, b1) in zip(pairwise(A), pairwise(B), strict=True)
    ]
    # A_0 A_1^-1 Y = Y B_0 B_1^-1
    alphas, betas = (
        np.array([Rotation.from_matrix(m[k][:3, :3]).as_rotvec() for m in motions]) for k in (0, 1)
    )  # fmt: skip
    M = betas.T @ alphas
    U, d, Vt = np.linalg.svd(M.T @ M)
    RY = U @ np.diag(d**-0.5) @ Vt @ M.T
    C = np.concatenate([np.eye(3) - a[:3, :3] for a, _ in motions])
    e = np.concatenate([a[:3, 3] - RY @ b[:3, 3] for a, b in motions])
    tY = np.linalg.lstsq(C, e, rcond=None)[0]
    _, Y = hand_eye(np.array([T(a) for a in A]), np.array([T(b) for b in B]))
    np.testing.assert_allclose(Y[:3, :3], RY, atol=1e-6)
    np.testing.assert_allclose(Y[:3, 3], tY, atol=1e-5)


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("what", ["points", "poses"])
def test_the_stated_uncertainty_is_that_of_many_repetitions(what: str) -> None:
    errors, stated = [], []
    for seed in range(60):
        if what == "points":
            Y, seen, own = points(3, 8)
            seen = seen + 0.001 * np.random.default_rng(seed).normal(size=seen.shape)
            found = of_points(seen, own)
        else:
            Y, _, A, B = poses(3, 8)
            random = np.random.default_rng(seed)
            A[:, :3] += 0.001 * random.normal(size=(8, 3))
            turned = Rotation.from_rotvec(0.001 / LIMITS.lever * random.normal(size=(8, 3)))
            A[:, 3:] = (turned * Rotation.from_quat(A[:, 3:], scalar_first=True)).as_quat(scalar_first=True)
            found = of_poses(A, B)
        errors.append(apart(found.pose, Y))
        stated.append(found.uncertain)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(stated), axis=0))
    assert (ratio > 0.75).all()
    assert (ratio < 1.25).all()


def test_points_near_a_line_are_refused() -> None:
    _, _, own = points(2)
    own[:, 1:] *= 0.01
    with pytest.raises(MountError, match="near a line"):
        of_points(own, own)


def test_points_in_a_plane_are_taken() -> None:
    Y, _, own = points()
    own[:, 2] = 0.0
    found = of_points(own @ T(Y)[:3, :3].T + Y[:3], own)
    assert max(apart(found.pose, Y)) < 1e-6


def test_a_mirrored_set_is_refused() -> None:
    _, seen, own = points()
    with pytest.raises(MountError, match="mirror image"):
        of_points(seen, own * [1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.03, r"\+3\.0 % larger"), (0.97, r"-3\.0 % larger"),
        (1000.0, "points in the parent are 1000 times larger: that looks like millimetres"),
        (0.001, "points in the frame are 1000 times larger: that looks like millimetres"),
    ],
)  # fmt: skip
def test_another_scale_is_refused(factor: float, words: str) -> None:
    _, seen, own = points()
    with pytest.raises(MountError, match=words):
        fit("points", range(1, 9), factor * seen, own, 0.0, Thresholds(apart=1e-5))


def test_one_percent_of_scale_is_left_to_the_points() -> None:
    _, seen, own = points()
    assert refusals(of_points(1.01 * seen, own), Thresholds(position=0.03, uncertain=0.03, askew=0.03)) == ()


@pytest.mark.parametrize("what", ["points", "poses"])
def test_the_one_that_is_wrong_is_named(what: str) -> None:
    if what == "points":
        _, seen, own = points(noise=0.0003)
        seen[4] += [0.03, 0.0, 0.0]
        found = of_points(seen, own)
    else:
        _, _, A, B = poses(noise=0.0003)
        A[4, :3] += [0.03, 0.0, 0.0]
        found = of_poses(A, B)
    (refused,) = refusals(found, LIMITS)
    assert refused.place == f"{what[:-1]} 5"
    assert "off where the other 7 say" in refused.problem
    assert "--redo N" in refused.remedy


def test_several_wrong_ones_are_all_told() -> None:
    _, seen, own = points()
    seen += 0.03 * np.random.default_rng(7).normal(size=seen.shape)
    assert len(refusals(of_points(seen, own), LIMITS)) > 1


def test_poses_about_one_axis_are_refused() -> None:
    Y, X, _, B = poses()
    for k, b in enumerate(B):
        b[3:] = Rotation.from_rotvec([0.0, 0.0, 0.3 * k]).as_quat(scalar_first=True)
    A = np.array([as_pose(T(Y) @ T(b) @ np.linalg.inv(T(X))) for b in B])
    assert axes(B) < 1e-6
    with pytest.raises(MountError, match=r"about one axis: about others by 0\.00 rad"):
        of_poses(A, B)


def test_too_few_like_each_other_or_unseen_are_refused() -> None:
    _, seen, own = points()
    with pytest.raises(MountError, match="3 are held, 4 are needed"):
        of_points(seen[:3], own[:3])
    with pytest.raises(MountError, match="it is like point 1"):
        of_points(np.vstack([seen, seen[:1]]), np.vstack([own, own[:1]]))
    with pytest.raises(MountError, match="some aren't measured"):
        of_points(np.where(seen == seen[0, 0], np.nan, seen), own)


@pytest.mark.slow
@pytest.mark.parametrize(("place", "turn"), [(1e-3, 1e-5), (1e-4, 5e-3)], ids=["places", "rotations"])
def test_the_stated_deviation_holds_whichever_error_is_the_larger(place: float, turn: float) -> None:
    random = np.random.default_rng(4)
    off, stated = [], []
    for seed in range(25):
        Y, _, A, B = poses(seed)
        B[:, :3] += place * random.normal(size=(8, 3))
        turned = Rotation.from_rotvec(turn * random.normal(size=(8, 3)))
        B[:, 3:] = (Rotation.from_quat(B[:, 3:], scalar_first=True) * turned).as_quat(scalar_first=True)
        found = fit("poses", range(1, 9), A, B, 0.0, Thresholds(turned=0.01, axes=0.01))
        off.append(apart(found.pose, Y))
        stated.append(found.uncertain)
    ratio = np.sqrt(np.mean(np.square(off), axis=0) / np.mean(np.square(stated), axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)
    assert np.mean(np.less(off, 2.0 * np.array(stated)), axis=0).min() >= 0.88


@pytest.mark.parametrize(
    ("known", "order"),
    [
        ([[0, 0, 0], [0.2, 0, 0], [0.2, 0.2, 0], [0, 0.2, 0]], True),
        ([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0], [0, 0.2, 0]], True),
        ([[0, 0, 0], [0.2, 0, 0], [0, 0.204, 0], [0.2, 0.2, 0]], True),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], True),
        ([[x, y, 0] for x in np.arange(6) / 5 for y in np.arange(5) / 5], True),
        ([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0.25, 0.25, 0]], False),
        ([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0.2, 0.2, 0.1]], False),  # only its mirror image, which is refused
        ([[0, 0, 0]] * 4, False),
        ([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]], False),  # on a line, which is refused, too
    ],
)
def test_points_that_fit_in_another_order_are_found(known: list[list[float]], order: bool) -> None:
    points = np.array(known, float)
    found = exchanged(points)
    assert (found is not None) == order
    if found is not None:
        moved = points[np.array(found) - 1]
        R, t = rigid(moved, points)
        assert np.linalg.norm(points @ R.T + t - moved, axis=1).max() < 0.01


@given(seeds, st.integers(4, 30))
def test_points_at_random_have_one_order(seed: int, n: int) -> None:
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (n, 3))
    found = exchanged(points)
    if found is not None:
        moved = points[np.array(found) - 1]
        R, t = rigid(moved, points)
        assert np.linalg.norm(points @ R.T + t - moved, axis=1).max() < 0.01
