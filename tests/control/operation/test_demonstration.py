"""A demonstration becomes a path with its timing, or is refused with the reason."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.control.operation.demonstration import PERIOD, TaskError, TaskPath, Thresholds, path_of
from srl.runtime.contracts.signals import Array

SECONDS = 4.0


def shown(times: Array, speed: float = 1.0) -> Array:
    """A slow arc, at rest at both ends."""
    u = np.clip(speed * times / SECONDS, 0.0, 1.0)
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    return np.stack([0.15 * np.cos(3.0 * s), 0.15 * np.sin(3.0 * s), 0.3 + 0.05 * s], axis=1)


@given(st.integers(0, 1000))
def test_path_is_where_the_hand_was_whenever_its_samples_came(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0.0, SECONDS, 400)) + rng.uniform(-50.0, 50.0)
    clean = shown(times - times[0])
    path = path_of(times, clean + rng.normal(0.0, 0.002, clean.shape))
    fine = shown(np.linspace(0, SECONDS, 2000))
    nearest = [np.linalg.norm(fine - p, axis=1).min() for p in path.points]
    assert np.quantile(nearest, 0.9) < 0.004
    assert max(nearest) < 0.01
    assert path.length == pytest.approx(np.linalg.norm(np.diff(fine, axis=0), axis=1).sum(), rel=0.05)
    assert path.duration < SECONDS


def test_rest_at_both_ends_is_cut_off() -> None:
    times = np.arange(0.0, 10.0, 0.01)
    path = path_of(times, shown(times - 3.0))
    assert path.duration == pytest.approx(SECONDS, abs=0.8)


@given(st.floats(-1.0, 6.0))
def test_velocity_is_the_derivative_of_the_place(s: float) -> None:
    times = np.arange(0.0, SECONDS, 0.01)
    path = path_of(times, shown(times))
    h = 1e-6
    before, after = path.at(s - h)[0], path.at(s + h)[0]
    assert path.at(s)[1] == pytest.approx((after - before) / (2 * h), abs=2e-4)


def test_path_goes_through_its_points_and_rests_beyond_them() -> None:
    path = TaskPath(np.random.default_rng(1).normal(0.0, 0.1, (9, 3)))
    for i, point in enumerate(path.points):
        assert path.at(i * PERIOD)[0] == pytest.approx(point, abs=1e-12)
    for s in (-1.0, 0.0, path.duration, path.duration + 1.0):
        assert np.abs(path.at(s)[1]).max() < 1e-9


@pytest.mark.parametrize(
    ("times", "points", "why"),
    [
        (np.arange(0, 0.5, 0.01), shown(np.arange(0, 0.5, 0.01), 10.0), "are needed"),
        (np.arange(0, 4, 0.01), 0.1 * shown(np.arange(0, 4, 0.01)), "mm long"),
        (np.arange(0, 4, 0.01), 8.0 * shown(np.arange(0, 4, 0.01)), "m/s"),
        (np.arange(0, 4, 0.01), np.zeros((400, 3)), "moved for"),
        (np.arange(0, 0.03, 0.01), np.zeros((3, 3)), "samples"),
        (np.arange(0, 100, 0.05), shown(np.arange(0, 100, 0.05), 0.04), "are the most"),
    ],
)
def test_what_cannot_be_repeated_is_refused(times: Array, points: Array, why: str) -> None:
    with pytest.raises(TaskError, match=why):
        path_of(times, points, Thresholds(still=0.001))


def test_gap_is_refused_and_its_place_said() -> None:
    times = np.arange(0.0, SECONDS, 0.01)
    points = shown(times)
    points[200:220] = np.nan
    with pytest.raises(TaskError, match=r"0\.21 s, 2\.0 s after"):
        path_of(times, points)
    points[201:] = shown(times)[201:]
    path_of(times, points)
