"""Calibration against an arm whose null space is known: directions, ranges, signs, several DoFs, refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.null_space_arm import HALF, MIDDLE, POINTS, Arm, recorded
from numpy.linalg import norm

from srl.control.ikns import calibration
from srl.control.ikns.calibration import Calibration, CalibrationError, Recording, calibrate, refusals
from srl.control.ikns.clusters import box_points, hand_speed, k_means, trimmed
from srl.control.ikns.sibson import Sibson
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.signals import Array

FEW = Thresholds(samples=30)


@cache
def arm(chain: str = "arm") -> Arm:
    return Arm(chain)


@cache
def trials(half: float, chain: str = "arm", k: int = 1) -> list[list[Array]]:
    """trials[point][dof]: the elbow swings by +-half rad; the clavicle lifts, then goes forward, by +-0.25 rad."""
    found = []
    for place in POINTS:
        q = arm(chain).at(place)
        more = [arm(chain).shrug(q, joint, 0.25, 41) for joint in (1, 0)[: k - 1]]
        found.append([arm(chain).swing(q, half, 61), *more])
    return found


@cache
def recording(half: float, chain: str = "arm", k: int = 1) -> Recording:
    return recorded(arm(chain), trials(half, chain, k))


@cache
def found(half: float, chain: str = "arm", k: int = 1) -> Calibration:
    return calibrate(recording(half, chain, k), FEW)


def nearest(c: Calibration) -> list[int]:
    """The index in `c` of each of POINTS."""
    return [int(norm(c.sites - p, axis=1).argmin()) for p in POINTS]


def read(c: Calibration, sibson: Sibson, q: Array, hand: Array) -> Array:
    """(k,): c at joint angles q, by the paper's formula."""
    w = sibson.weights(hand)
    z, m, M = np.tensordot(w, c.directions, 1), w @ c.lower, w @ c.upper
    result: Array = (z @ q - m) / np.abs(M - m)
    return result


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize(("half", "degrees"), [(0.1, 0.05), (0.25, 0.3), (0.5, 1.0), (0.8, 2.5)])
def test_the_direction_lies_in_the_null_space(half: float, degrees: float) -> None:
    """At each point's mean posture. Beyond 0.25 rad of swivel the null space itself is curved."""
    c = found(half)
    for point, i in enumerate(nearest(c)):
        (null,) = arm().null(trials(half)[point][0].mean(axis=0))
        z = c.directions[i, 0]
        assert norm(z) == pytest.approx(1.0)
        assert np.rad2deg(np.arcsin(norm(z - null * (null @ z)))) < degrees
    assert refusals(c, FEW) == ()
    assert c.explained.min() > 0.97
    assert c.agreement.min() > 0.8
    assert c.wander.max() < 1e-9
    assert c.lost == c.jumps == 0
    assert (c.samples == 61).all()


@pytest.mark.parametrize("components", ["first", "sum"])
def test_neither_signs_nor_order_matter(components: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the hand wandering, so that the sum has several components."""
    rng = np.random.default_rng(2)
    plain = recording(0.25)
    noisy = replace(plain, angles=plain.angles + rng.normal(size=plain.angles.shape) * 0.04)
    th = Thresholds(samples=30, components=components, share=0.8 if components == "first" else 0.95)
    c = calibrate(noisy, th)
    eigh = np.linalg.eigh
    for seed in range(3):
        signs = np.random.default_rng(seed)
        monkeypatch.setattr(
            calibration.np.linalg, "eigh", lambda a, s=signs: (eigh(a)[0], eigh(a)[1] * s.choice([-1.0, 1.0], len(a)))
        )
        # Trials in another order of points, and each there and back.
        blocks = signs.permutation(len(POINTS))
        order = np.concatenate([np.arange(61 * b, 61 * (b + 1))[:: signs.choice([-1, 1])] for b in blocks])
        other = calibrate(replace(noisy, angles=noisy.angles[order], hand=noisy.hand[order], dof=noisy.dof[order]), th)
        for name in ("sites", "directions", "lower", "upper", "samples", "agreement"):
            assert getattr(other, name) == pytest.approx(getattr(c, name), abs=1e-9), name


@pytest.mark.slow
def test_all_points_have_one_sense() -> None:
    """More swivel is more (or less) of the control value everywhere."""
    c = found(0.5)
    ends = [np.diff(trials(0.5)[p][0][[0, -1]] @ c.directions[i, 0]).item() for p, i in enumerate(nearest(c))]
    assert len({np.sign(e) for e in ends}) == 1


def places(c: Calibration, n: int) -> Array:
    """(n, 3) m, between the points, 10 mm and more from the hull's surface."""
    rng, sibson, out = np.random.default_rng(1), Sibson(c.sites), []
    while len(out) < n:
        x = MIDDLE + rng.uniform(-1.0, 1.0, 3) * HALF
        if all(sibson.nearest(x + 0.01 * d).distance == 0.0 for s in (-1, 1) for d in s * np.eye(3)):
            out.append(x)
    return np.array(out)


@pytest.mark.slow
@pytest.mark.parametrize("half", [0.25, 0.8])
def test_c_rises_with_the_swivel_while_the_hand_is_still(half: float) -> None:
    """Where nothing was recorded: the ends are off by less than 0.1, and in between it is almost a straight line."""
    c = found(half)
    sibson = Sibson(c.sites)
    for x in places(c, 8):
        swing = arm().swing(arm().at(x), half, 31)
        value = np.array([read(c, sibson, q, x).item() for q in swing])
        value = value if value[-1] > value[0] else 1.0 - value
        assert (np.diff(value) > 0.0).all()
        assert value[[0, -1]] == pytest.approx([0.0, 1.0], abs=0.1)
        line = np.polyval(np.polyfit(np.arange(31), value, 1), np.arange(31))
        assert np.abs(value - line).max() < 0.09


@pytest.mark.slow
def test_a_hand_turned_by_20_degrees_or_moved_by_10_mm_changes_c_a_little() -> None:
    """At the same swivel angle, calibrated over its full range of 92 degrees."""
    c = found(0.8)
    sibson, rng = Sibson(c.sites), np.random.default_rng(0)
    turned, moved = [], []
    for x in places(c, 8):
        at = read(c, sibson, arm().at(x), x).item()
        for way in (v / norm(v) for v in rng.normal(size=(4, 3))):
            turned.append(abs(read(c, sibson, arm().at(x, np.deg2rad(20.0) * way), x).item() - at))
            moved.append(abs(read(c, sibson, arm().at(x + 0.01 * way), x + 0.01 * way).item() - at))
    assert np.median(turned) < 0.10
    assert max(turned) < 0.18
    assert max(moved) < 0.025


@pytest.mark.slow
@pytest.mark.parametrize("k", [2, 3])
def test_several_dofs_hardly_disturb_each_other(k: int) -> None:
    """Swivel, shrug and protraction, each in its own trials."""
    c = found(0.5, "clavicle", k)
    assert refusals(c, FEW) == ()
    others = ~np.eye(k, dtype=bool)
    assert 0.0 < c.crosstalk[:, others].max() < 0.08
    assert np.diagonal(c.crosstalk, axis1=1, axis2=2) == pytest.approx(1.0)
    for p, i in enumerate(nearest(c)):
        for j in range(k):
            q = trials(0.5, "clavicle", k)[p][j]
            value = (q @ c.directions[i].T - c.lower[i]) / (c.upper[i] - c.lower[i])
            assert np.ptp(value[:, j]) == pytest.approx(1.0)
            assert c.crosstalk[i, :, j] == pytest.approx(np.ptp(value, axis=0))
    # The dual basis is what does it: the trials' own directions aren't orthogonal.
    gram = c.directions @ c.directions.transpose(0, 2, 1)
    assert np.abs(gram[:, others]).max() > 0.2


def test_a_dof_that_moves_in_the_trials_of_another_is_refused() -> None:
    """It goes there and back while the other goes there, so no straight line through the samples shows it."""
    Z = np.linalg.qr(np.random.default_rng(0).normal(size=(9, 9)))[0]
    s = np.sin(np.linspace(0, 4 * np.pi, 500))[:, None]
    moved = [0.8 * s * Z[0] + 0.5 * (0.8 * s) ** 2 * Z[1], 0.15 * s * Z[1]]
    rows = [(q, point, dof) for point in POINTS for dof, q in enumerate(moved)]
    times = np.concatenate([6.0 * i + np.arange(500) * 0.01 for i in range(len(rows))])
    hand = np.concatenate([np.tile(point, (500, 1)) for _, point, _ in rows])
    dof = np.repeat([d for *_, d in rows], 500)
    made = calibrate(Recording(times, np.concatenate([q for q, *_ in rows]), hand, dof))
    assert made.crosstalk[:, 1, 0].max() > 1.0
    output = refusals(made)
    assert len(output) == len(POINTS)
    assert all("of its range in the trial of DoF 1" in str(reason) for reason in output)


@pytest.mark.slow
def test_a_file_in_other_units_is_refused() -> None:
    c = found(0.5)
    for change, words in (
        ({"sites": 1e3 * c.sites}, "in mm"),
        ({"directions": 10.0 * c.directions}, "lengths"),
        ({"lower": np.rad2deg(c.lower), "upper": np.rad2deg(c.upper)}, "in degrees"),
        ({"travel": 0.0 * c.travel}, "no motion"),
    ):
        assert any(words in str(reason) for reason in refusals(replace(c, **change), FEW)), words


def test_one_point_whose_sense_was_turned_round_is_refused() -> None:
    """As a file changed by hand has it: the range fits the direction, and between two points c turns round."""
    c = found(0.5)
    for i in range(len(c.sites)):
        sense = np.where(np.arange(len(c.sites)) == i, -1.0, 1.0)
        lower, upper = c.lower.copy(), c.upper.copy()
        lower[i], upper[i] = -c.upper[i], -c.lower[i]
        turned = replace(c, directions=sense[:, None, None] * c.directions, lower=lower, upper=upper)
        text = " ".join(map(str, refusals(turned, FEW)))
        assert "degrees, so between them the sense turns round. Redo both" in text
        assert str(i + 1) in text
    assert not refusals(c, FEW)


@pytest.mark.slow
def test_two_dofs_whose_motions_agree_are_no_turned_sense() -> None:
    """A second motion at 20 degrees to either side of the first: the directions that read it are 140 degrees apart."""
    c = found(0.5, "clavicle", 2)
    Z = np.array([np.linalg.pinv(B).T for B in c.directions])
    first, second = (Z[:, j] / norm(Z[:, j], axis=1)[:, None] for j in (0, 1))
    aside = second - (second * first).sum(axis=1)[:, None] * first
    aside /= norm(aside, axis=1)[:, None]
    sense = np.where(np.arange(len(Z)) % 2, 1.0, -1.0)[:, None]
    near = np.cos(np.deg2rad(20.0)) * first + np.sin(np.deg2rad(20.0)) * sense * aside
    B = np.array([np.linalg.pinv(np.stack(pair).T) for pair in zip(first, near, strict=True)])
    assert not any("turns round" in str(reason) for reason in refusals(replace(c, directions=B), FEW))


def test_ranges_that_the_joints_didnt_go_through_are_refused() -> None:
    c = found(0.5)
    for change in (
        {"upper": c.upper + 3.0},
        {"travel": 1e-9 * c.travel},
        {"lower": c.lower + 1e5, "upper": c.upper + 1e5},
    ):
        assert any("no motion of an arm" in str(reason) for reason in refusals(replace(c, **change), FEW)), change


def test_the_sum_explains_what_is_along_it() -> None:
    """Two components of 60 and 35 %: their sum, at 30 degrees to the first, explains 57 %, not 95 %."""
    rng = np.random.default_rng(1)
    good = recording(0.5)
    n = 400
    q = np.zeros((10 * n, 7))
    q[:, 0], q[:, 1], q[:, 2] = (scale * rng.uniform(-1.0, 1.0, 10 * n) for scale in np.sqrt([0.60, 0.35, 0.05]))
    hand = np.repeat(np.array([good.hand[61 * i] for i in range(10)]), n, axis=0)
    made = replace(
        good,
        times=np.arange(10 * n) * 0.01,
        angles=q,
        hand=hand,
        dof=np.zeros(10 * n, int),
        point=np.repeat(np.arange(10), n),
    )
    c = calibrate(made, Thresholds(samples=30, components="sum", share=0.9, speed=0.2))
    Z = c.directions[:, 0]
    shares = np.array(
        [np.var(q[n * i : n * (i + 1)] @ Z[i]) / q[n * i : n * (i + 1)].var(axis=0).sum() for i in range(10)]
    )
    np.testing.assert_allclose(c.explained[:, 0], shares, rtol=0.02)
    assert 0.5 < c.explained.min() < 0.7  # less than the first component alone must have
    assert c.explained.max() < 0.75


# Clusters


def test_the_box() -> None:
    hand = np.array([[0.0, 0.0, 0.0], [2.0, 4.0, 6.0], [1.0, 1.0, 1.0]])
    ten = box_points(hand, 10, up=2)
    assert {tuple(p) for p in ten[:8]} == {(x, y, z) for x in (0, 2) for y in (0, 4) for z in (0, 6)}
    assert ten[8:].tolist() == [[1.0, 2.0, 0.0], [1.0, 2.0, 6.0]]
    assert box_points(hand, 10, up=0)[8:].tolist() == [[0.0, 2.0, 3.0], [2.0, 2.0, 3.0]]
    every = box_points(hand, 26, up=2)
    assert len({tuple(p) for p in every}) == 26
    assert (np.abs((every - [1, 2, 3]) / [1, 2, 3]).max(axis=1) == 1.0).all()


def test_strays_are_discarded() -> None:
    rng = np.random.default_rng(0)
    hand = np.repeat(POINTS, 50, axis=0) + rng.normal(size=(500, 3)) * 0.004
    hand[::50] += 0.05 * (MIDDLE - POINTS) / norm(MIDDLE - POINTS, axis=1)[:, None]  # on its way
    centroids, cluster = trimmed(hand, *k_means(hand, box_points(hand, 10, up=2)), radius=0.03)
    assert (cluster[::50] == -1).all()
    assert (np.delete(cluster.reshape(10, 50), 0, axis=1) >= 0).all()
    assert np.sort(norm(POINTS[:, None] - centroids, axis=2).min(axis=1)).max() < 0.003


@pytest.mark.slow
def test_the_hands_speed() -> None:
    times = np.sort(np.random.default_rng(3).uniform(0.0, 3.0, 400))
    hand = times[:, None] * [0.03, 0.0, -0.04] + [1.0, 2.0, 3.0]
    assert hand_speed(times, hand) == pytest.approx(0.05)
    hand[100:200] = np.nan
    speed = hand_speed(times, hand)
    assert np.isnan(speed[120:180]).all()
    assert speed[np.isfinite(speed)] == pytest.approx(0.05)
    hours = np.arange(50_000) * 0.01 + 8 * 3600.0
    walked = np.random.default_rng(5).normal(size=(50_000, 3)).cumsum(axis=0) * 1e-4
    assert hand_speed(hours, walked) == pytest.approx(hand_speed(hours - 8 * 3600.0, walked), abs=1e-6)
    long = np.arange(360_000) * 0.01  # an hour
    assert hand_speed(long, long[:, None] * [0.03, 0.0, -0.04]) == pytest.approx(0.05, abs=1e-6)
    noisy = np.random.default_rng(4).normal(size=(500, 3)) * 5e-4
    assert np.percentile(hand_speed(np.arange(500) / 100, noisy), 99) < 0.025  # differences would say 0.04


# Refusals


def refused(recording: Recording, **thresholds: Any) -> str:
    th = Thresholds(**{"samples": 30, **thresholds})
    return "\n".join(map(str, refusals(calibrate(recording, th), th)))


def test_what_cant_work_is_refused_with_place_reason_and_remedy() -> None:
    good = recording(0.25)
    assert refused(good) == ""
    assert refused(good, samples=62).count("samples kept: 61, needed: 62") == 10
    assert "Redo the point, longer or with the hand stiller." in refused(good, samples=62)
    assert refused(good, range=2.0).count("the range is") == 10
    assert "there and back" in refused(good, explained=0.9999)

    here = np.arange(len(good.hand)) // 61
    flat = replace(good, hand=good.hand * [1.0, 0.0, 1.0])
    assert "points: they are not a volume: 0.0 mm rms from a common plane" in refused(flat)
    lost = replace(good, angles=np.where((np.arange(len(here)) % 3 == 0)[:, None], np.nan, good.angles))
    assert "recording: 33% of the samples lack angles or hand" in refused(lost, samples=10)
    wrapped = replace(good, angles=(good.angles + np.pi) % (2 * np.pi) - np.pi + 2 * np.pi * (here % 2)[:, None])
    assert "angles jump by more than half a turn" in refused(wrapped)


def test_a_hand_that_isnt_still_is_refused() -> None:
    good = recording(0.25)
    waves = np.sin(np.arange(61) * 2 * np.pi / 61)[:, None] * [0.02, 0.0, 0.0]
    slow = replace(good, times=good.times * 4.0, hand=good.hand + np.tile(waves, (10, 1)))
    text = refused(slow, radius=0.1, wander=0.01)
    assert len(re.findall(r"the hand wandered by 1\d mm rms, 10 mm are allowed\. Redo the point", text)) == 10
    with pytest.raises(CalibrationError, match=r"no sample of 610 is left: 0 without .* faster than 0.05 m/s\. Hold"):
        calibrate(replace(good, hand=good.hand + good.times[:, None] * [0.06, 0.0, 0.0]), FEW)


@pytest.mark.slow
def test_dofs_that_are_one_motion_are_refused() -> None:
    twice = recorded(arm(), [[q, q[::-1]] for [q] in trials(0.25)])
    assert refused(twice).count("degrees apart from the other DoFs' motions") == 20


def test_a_sense_that_is_a_guess_is_refused() -> None:
    good = recording(0.25)
    angles, z = good.angles.copy(), found(0.25).directions[nearest(found(0.25))[0], 0]
    aside = np.eye(7)[6] - z * z[6]
    angles[:61] = angles[:61].mean(axis=0) + np.linspace(-0.3, 0.3, 61)[:, None] * aside / norm(aside)
    text = refused(replace(good, angles=angles))
    assert "so its sense is a guess. Redo the point with the same motion as at the others" in text
