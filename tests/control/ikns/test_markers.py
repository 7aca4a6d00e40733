"""Angles from made-up markers: exact, noisy, swapped, hidden, lost and found again."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from helpers.mocap import made, off, reaching
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.ikns.markers import MarkerFit
from srl.runtime.models.body import Body, average

BODY = average(1.75)
ARM = average(1.75, ("right",))
SEEN = np.ones(len(ARM.markers), bool)
DT = 0.01
WRIST = [ARM.names.index(f"right_wrist_{joint}") for joint in ("flexion", "deviation")]


def follow(
    fit: MarkerFit, q: np.ndarray, noise: float = 0.0, hidden: dict[str, slice] | None = None
) -> dict[str, np.ndarray]:
    """Runs a motion through the fit; angles, held, rejected and residual of each frame."""
    rng = np.random.default_rng(5)
    rows: dict[str, list[np.ndarray]] = {"angles": [], "held": [], "rejected": [], "residual": []}
    for i, posture in enumerate(q):
        points = made(fit.body, posture) + rng.normal(0.0, 1.0, (len(fit.names), 3)) * noise
        visible = np.ones(len(fit.names), bool)
        for name, when in (hidden or {}).items():
            visible[fit.names.index(name)] = i not in range(len(q))[when]
        points[~visible] = 9.9
        fit.solve(points, visible, DT, starts=6)
        for key, row in rows.items():
            row.append(np.copy(getattr(fit, key)))
    return {key: np.array(row) for key, row in rows.items()}


@pytest.mark.parametrize("body", [BODY, ARM], ids=["24", "15"])
def test_exact_markers_give_the_angles(body: Body) -> None:
    q = reaching(body, 150)
    seen = follow(MarkerFit(body), q)
    assert off(seen["angles"], q).max() < 0.15  # the prior lags behind what speeds up
    assert not seen["held"].any()
    assert not seen["rejected"].any()
    still = np.repeat(q[:1], 5, axis=0)
    assert off(follow(MarkerFit(body), still)["angles"], still)[-1].max() < 1e-4


def test_a_millimetre_of_noise_moves_the_angles_by_about_a_degree() -> None:
    q = reaching(ARM, 300)
    seen = follow(MarkerFit(ARM), q, noise=1e-3)
    rms = np.sqrt((off(seen["angles"], q) ** 2).mean(axis=0))
    by_name = dict(zip(ARM.names[3:], rms, strict=True))
    assert by_name["right_elbow_flexion"] < 0.5
    assert max(by_name.values()) < 2.0
    assert not seen["rejected"].any()
    assert seen["residual"].mean() == pytest.approx(np.sqrt(3 - 15 / 11) * 1e-3, rel=0.1)


def test_swapped_wrist_markers_are_both_rejected_and_the_angles_go_on() -> None:
    q = reaching(ARM, 120)
    fit = MarkerFit(ARM)
    a, b = fit.names.index("RWRA"), fit.names.index("RWRB")
    angles, rejected = [], []
    for i, posture in enumerate(q):
        points = made(ARM, posture)
        if 40 <= i < 80:
            points[[a, b]] = points[[b, a]]
        assert fit.solve(points, np.ones(len(points), bool), DT, starts=6)
        angles.append(fit.angles.copy())
        rejected.append(fit.rejected.copy())
    assert [{fit.names[i] for i in np.flatnonzero(row)} for row in rejected] == [
        {"RWRA", "RWRB"} if 40 <= i < 80 else set() for i in range(120)
    ]
    assert off(np.array(angles), q).max() < 1.0


def test_swapped_wrist_markers_stay_rejected_through_noise() -> None:
    """Without its bar the wrist is noisy, and doesn't turn over."""
    q, rng = reaching(ARM, 600), np.random.default_rng(0)
    fit = MarkerFit(ARM)
    a, b = fit.names.index("RWRA"), fit.names.index("RWRB")
    angles = []
    for i, posture in enumerate(q):
        points = made(ARM, posture) + rng.normal(0.0, 1e-3, (len(fit.names), 3))
        if i >= 200:
            points[[a, b]] = points[[b, a]]
        assert fit.solve(points, np.ones(len(points), bool), DT, starts=6)
        if i >= 200:
            assert set(np.flatnonzero(fit.rejected)) == {a, b}
        angles.append(fit.angles.copy())
    wrong = off(np.array(angles), q)[200:]
    assert wrong.max() < 10.0
    assert np.sqrt((wrong**2).mean(axis=0)).max() < 3.0


def test_a_chest_with_crossed_markers_isnt_begun_with() -> None:
    """C7 and T10 crossed leave 23 mm of residual: every marker is within the gate."""
    fit, points = MarkerFit(ARM), made(ARM, reaching(ARM, 1)[0])
    a, b = fit.names.index("C7"), fit.names.index("T10")
    points[[a, b]] = points[[b, a]]
    for _ in range(20):
        assert not fit.solve(points, SEEN, DT, starts=6)
    assert fit.held.all()


def test_without_fin_the_wrist_is_held_and_is_seen_at_once_afterwards() -> None:
    q = reaching(ARM, 300)
    seen = follow(MarkerFit(ARM), q, hidden={"RFIN": slice(100, 150)})
    expected = np.zeros_like(seen["held"])
    expected[np.ix_(range(100, 150), WRIST)] = True
    np.testing.assert_array_equal(seen["held"], expected)
    assert np.ptp(seen["angles"][100:150, WRIST], axis=0).max() < 1e-9
    others = np.delete(off(seen["angles"], q), [w - 3 for w in WRIST], axis=1)
    assert others.max() < 1.2
    assert off(seen["angles"], q)[150:].max() < 1.2
    steps = np.abs(np.diff(seen["angles"], axis=0))
    steps[149, WRIST] = 0.0  # where `held` falls
    assert steps.max() < np.abs(np.diff(q, axis=0)).max() + np.deg2rad(1.5)
    assert off(seen["angles"], q)[-1].max() < 0.1


@pytest.mark.parametrize("other", ["RWRA", "RWRB"])
def test_fin_swapped_with_a_wrist_marker_isnt_followed(other: str) -> None:
    """For 2 s: FIN alone shows the wrist, but the wrist was seen before."""
    q = reaching(ARM, 300)
    fit = MarkerFit(ARM)
    a, b = fit.names.index("RFIN"), fit.names.index(other)
    angles = []
    for i, posture in enumerate(q):
        points = made(ARM, posture)
        if 50 <= i < 250:
            points[[a, b]] = points[[b, a]]
        assert fit.solve(points, SEEN, DT, starts=6)
        swapped = 50 <= i < 250
        assert fit.held[WRIST].tolist() == [swapped, swapped], i
        assert set(np.flatnonzero(fit.rejected)) == ({a, b} if swapped else set())
        angles.append(fit.angles.copy())
    assert np.ptp(np.array(angles)[50:250, WRIST], axis=0).max() < 1e-9
    assert off(np.delete(angles, WRIST, axis=1), np.delete(q, WRIST, axis=1)).max() < 2.0


@pytest.mark.slow
@given(st.floats(0.05, 0.3), st.floats(-1.0, 1.0), st.floats(-np.pi, np.pi), st.integers(1, 40))
def test_a_ghost_of_fin_holds_the_wrist(far: float, height: float, way: float, count: int) -> None:
    """Any point that FIN leaps to from a still hand, beyond what a hand's acceleration explains."""
    q = reaching(ARM, 1)[0]
    fit, points = MarkerFit(ARM), made(ARM, q)
    for _ in range(5):
        fit.solve(points, SEEN, DT, starts=6)
    ghost, level = points.copy(), np.sqrt(1.0 - height**2)
    ghost[fit.names.index("RFIN")] += far * np.array([level * np.cos(way), level * np.sin(way), height])
    before = fit.angles.copy()
    for _ in range(count):
        assert fit.solve(ghost, SEEN, DT)
        assert fit.held[WRIST].all()
    np.testing.assert_allclose(fit.angles, before, atol=1e-3)


def test_a_fin_that_stays_elsewhere_is_believed_at_last() -> None:
    """What held the wrist was wrong: a marker that somebody turned, say."""
    q = reaching(ARM, 1)[0]
    fit = MarkerFit(ARM)
    fit.solve(made(ARM, q), SEEN, DT, starts=6)
    q[WRIST[0]] += 1.0
    held = []
    for _ in range(100):
        assert fit.solve(made(ARM, q), SEEN, DT)
        held.append(fit.held[WRIST].all())
    assert held == [True] * 50 + [False] * 50
    assert off(fit.q[None], q[None]).max() < 0.1


def test_a_fin_that_was_hidden_may_come_back_anywhere() -> None:
    q = reaching(ARM, 1)[0]
    fit = MarkerFit(ARM)
    fit.solve(made(ARM, q), SEEN, DT, starts=6)
    hidden = SEEN.copy()
    hidden[fit.names.index("RFIN")] = False
    fit.solve(made(ARM, q), hidden, DT)
    q[WRIST[0]] += 1.0
    fit.solve(made(ARM, q), SEEN, DT)
    assert not fit.held.any()
    assert not fit.rejected.any()


def test_what_a_marker_is_needed_for() -> None:
    fit = MarkerFit(ARM)
    assert fit.needed("RFIN") == ("right_wrist_flexion", "right_wrist_deviation")
    assert fit.needed("RUPA") == ()
    assert not fit.observed(["CLAV", "C7", "STRN", "T10"])[6:].any()
    assert fit.observed(fit.names).all()


@pytest.mark.slow
def test_markers_that_come_and_go_make_no_steps() -> None:
    body = ARM
    q = reaching(body, 400)
    rng = np.random.default_rng(1)
    wrong = {n: rng.normal(0.0, 0.006, 3) for n in body.markers}  # skin: each marker off its place
    fit = MarkerFit(body)
    angles, held = [], []
    for posture in q:
        visible = rng.random(len(fit.names)) > 0.05
        points = made(body, posture) + np.array([wrong[n] for n in fit.names])
        fit.solve(points, visible, DT, starts=6)
        angles.append(fit.angles.copy())
        held.append(fit.held.copy())
    steps = np.rad2deg(np.abs(np.diff(angles, axis=0)))[:, 3:]
    moved = np.rad2deg(np.abs(np.diff(q, axis=0)))[:, 3:]
    again = (np.array(held)[:-1] & ~np.array(held)[1:])[:, 3:]
    assert again.any()
    assert (steps - moved)[~again].max() < 3.0


def test_angles_go_on_beyond_a_turn() -> None:
    body = ARM
    q = np.repeat(reaching(body, 1), 300, axis=0)
    q[:, body.names.index("torso_yaw")] = np.linspace(0.0, 15.0, 300)
    seen = follow(MarkerFit(body), q)
    assert seen["angles"][-1, body.names.index("torso_yaw")] == pytest.approx(15.0, abs=1e-3)


def test_a_frame_without_a_person_holds_everything_and_a_person_elsewhere_is_found() -> None:
    body, fit = ARM, MarkerFit(ARM)
    q = reaching(body, 1)[0]
    everywhere = np.ones(len(fit.names), bool)
    assert fit.solve(made(body, q), everywhere, DT, starts=6)
    before = fit.angles.copy()
    for _ in range(20):
        assert not fit.solve(made(body, q), ~everywhere, DT)
    np.testing.assert_array_equal(fit.angles, before)
    assert fit.held.all()
    assert not fit.known
    q[:4] += (1.5, -1.0, 0.2, 2.0)
    q[body.names.index("right_elbow_flexion")] += 0.5
    for _ in range(300):
        fit.solve(made(body, q), everywhere, DT)
    assert off(fit.angles[None], q[None]).max() < 0.01


def test_a_posture_isnt_taken_from_a_torso_alone() -> None:
    """Half of the markers are somebody else's: rather none than a limb that was left out."""
    fit, q = MarkerFit(ARM), reaching(ARM, 1)[0]
    points = made(ARM, q)
    for name in ("RELB", "RFRM", "RWRA", "RFIN"):
        points[fit.names.index(name)] += (0.5, 0.4, -0.3)
    assert not fit.solve(points, np.ones(len(points), bool), DT, starts=6)
    assert fit.held.all()


def test_points_that_arent_numbers_are_missing_ones() -> None:
    fit = MarkerFit(ARM)
    points = made(ARM, reaching(ARM, 1)[0])
    points[fit.names.index("RUPA")] = np.nan
    assert fit.solve(points, np.ones(len(points), bool), DT, starts=6)
    assert np.isfinite(fit.angles).all()
    assert not fit.used[fit.names.index("RUPA")]
    assert not fit.rejected.any()


@pytest.mark.parametrize("seed", range(6))
def test_the_posture_is_found_from_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = ARM.ranges[6:].T
    q = np.concatenate(
        [rng.normal(size=3), rng.uniform(-0.5, 0.5, 3), (low + high) / 2 + rng.uniform(-0.25, 0.25, 9) * (high - low)]
    )
    fit = MarkerFit(ARM)
    assert fit.solve(made(ARM, q), np.ones(len(fit.names), bool), DT, starts=6)
    assert fit.residual < 1e-4
    np.testing.assert_allclose(fit.predicted(fit.angles), made(ARM, q), atol=1e-3)


def test_the_derivative_is_that_of_the_points() -> None:
    fit, q = MarkerFit(BODY), reaching(BODY, 1)[0]
    np.testing.assert_allclose(fit.predicted(q), made(BODY, q), atol=1e-12)
    columns = [(fit.predicted(q + step) - fit.predicted(q - step)).ravel() / 2e-6 for step in 1e-6 * np.eye(len(q))]
    np.testing.assert_allclose(fit.jacobian(q), np.array(columns).T, atol=1e-8)


@pytest.mark.parametrize("gone", [("RELB", "RFRM", "RWRA"), ("C7", "RSHO", "RUPA", "RWRB")])
def test_a_fit_that_leaves_out_more_than_a_search_would_is_followed_and_not_shown(gone: tuple[str, ...]) -> None:
    """Somebody else's markers for 80 ms; afterwards the person is where they are seen, at once."""
    q, fit = reaching(ARM, 60), MarkerFit(ARM)
    wrong = [fit.names.index(name) for name in gone]
    for i, posture in enumerate(q):
        points = made(ARM, posture)
        if 30 <= i < 38:
            points[wrong] += (0.1, 0.15, -0.1)
        before = fit.angles.copy()
        assert fit.solve(points, SEEN, DT, starts=6)
        assert fit.held.all() == (30 <= i < 38), i
        if fit.held.all():
            assert fit.rejected.sum() > len(SEEN) // 4
            np.testing.assert_array_equal(fit.angles, before)
            np.testing.assert_allclose(fit.pose("right_hand").homogeneous, ARM.forward(before)["right_hand"], atol=1e-9)
        else:
            assert off(fit.angles[None], posture[None]).max() < (3.0 if 38 <= i < 42 else 0.3), i


@pytest.mark.exhaustive
@pytest.mark.slow
@given(st.integers(0, 10_000), st.floats(0.015, 0.05))
@settings(max_examples=30, deadline=None)
def test_whatever_is_seen_what_is_shown_fits_as_well_as_after_a_search(seed: int, size: float) -> None:
    q, fit, rng = reaching(ARM, 30), MarkerFit(ARM), np.random.default_rng(seed)
    for i, posture in enumerate(q):
        points = made(ARM, posture)
        if i % 10 > 4:
            points += rng.normal(0.0, size, points.shape)
        before = fit.angles.copy()
        seen = rng.random(len(SEEN)) > 0.1 * (i % 10 > 4)
        fit.solve(points, seen, DT, starts=6)
        if fit.held.all():
            np.testing.assert_array_equal(fit.angles, before)
        else:
            assert fit.rejected.sum() <= seen.sum() // 4
            assert fit.residual <= 0.5 * fit.gate


def test_what_is_kept_of_sets_of_markers_is_bounded() -> None:
    """Noise in the cameras shows every set sooner or later, and a session takes hours."""
    fit = MarkerFit(ARM)
    before = fit.needed("RFIN")
    sets = [c for count in range(12) for c in combinations(fit.names, count)]
    assert len(sets) == 2048
    for names in sets:
        fit.observed(names)
    assert len(fit._observability.kept) <= 256
    assert fit.needed("RFIN") == before


def test_a_first_fit_of_an_arm_that_isnt_seen_has_no_speed() -> None:
    """Of the torso alone, in no time, as at a reset: what comes then must not be where that speed leads."""
    q, fit = reaching(ARM, 1)[0], MarkerFit(ARM)
    points = made(ARM, q)
    torso = np.array([name in ("C7", "T10", "CLAV", "STRN") for name in fit.names])
    fit.reset()
    fit.solve(points, torso, 0.0, 6)
    for _ in range(5):
        fit.solve(points, np.ones(len(fit.names), bool), 0.01)
        shown = fit.angles[~fit.held]
        assert np.abs(shown).max() < 2 * np.pi
