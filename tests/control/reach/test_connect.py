"""The search for a way: every point of it is free, it is the same again, and it ends where there is none."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from srl.control.reach.connect import SPACING, Connect, Free, along
from srl.runtime.contracts.signals import Array

LOW, HIGH = np.array([-2.0, -2.0, -2.0]), np.array([2.0, 2.0, 2.0])
START, GOAL = np.array([-1.5, 0.0, 0.0]), np.array([1.5, 0.0, 0.0])


def wall(gap: float, seen: list[Array] | None = None, half: float = 0.3) -> Free:
    """A wall at x = 0, twice `half` thick, with a hole in a corner, of this size."""

    def free(points: Array) -> NDArray[np.bool_]:
        if seen is not None:
            seen.append(points)
        through = (points[:, 1] > 2.0 - gap) & (points[:, 2] > 2.0 - gap)
        found: NDArray[np.bool_] = (np.abs(points[:, 0]) > half) | through
        return found

    return free


def found(free: Free, seed: int, most: int = 4000) -> Array | None:
    search = Connect(START, GOAL, LOW, HIGH, free, seed)
    for _ in range(most):
        path = search.grow()
        if path is not None:
            return path
    return None


@given(st.integers(0, 10_000), st.floats(0.8, 2.0))
@settings(max_examples=30, deadline=None)
def test_a_way_begins_and_ends_where_it_should_and_is_free_throughout(seed, gap):
    free = wall(gap)
    path = found(free, seed)
    assert path is not None
    assert (path[0] == START).all()
    assert (path[-1] == GOAL).all()
    thinner = wall(gap + SPACING, half=0.3 - SPACING)  # between the points that were judged there are others
    assert all(thinner(along(a, b)).all() for a, b in pairwise(path))


def test_the_same_seed_finds_the_same_way_and_a_turn_asks_for_few_points():
    asked: list[Array] = []
    first = found(wall(1.0, asked), 7)
    again = found(wall(1.0), 7)
    assert first is not None
    assert again is not None
    assert (first == again).all()
    assert max(map(len, asked)) <= np.ceil((HIGH - LOW).max() / SPACING)


def test_a_wall_without_a_hole_has_no_way():
    assert found(wall(0.0), 1, most=150) is None


@pytest.mark.parametrize("far", [0.0, SPACING / 2, 1.0])
def test_points_along_a_way_are_near_each_other_and_end_at_its_end(far):
    points = along(START, START + far)
    assert points[-1] == pytest.approx(START + far)
    steps = np.diff(np.vstack([START, points]), axis=0)
    assert np.abs(steps).max() <= SPACING + 1e-12
