"""A way round what stands: free by a dense oracle; and the levers by which it is judged."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.cobot.robot_distances import RobotDistances
from srl.control.reach.arm_options import ReachDistancesConfig
from srl.control.reach.static import FLOOR, Way
from srl.runtime.models.robots import ARMS
from srl.runtime.profile import profile as profiles


@given(st.integers(0, 10_000), st.lists(st.tuples(*[st.floats(-0.8, 0.8)] * 2, st.floats(0.05, 0.4)), max_size=5))
@settings(max_examples=60, deadline=None)
def test_a_way_among_discs_is_free_by_a_dense_oracle(seed: int, discs: list[tuple[float, float, float]]) -> None:
    def margin(point: np.ndarray) -> float:
        return min((float(np.hypot(point[0] - x, point[1] - y)) - r for x, y, r in discs), default=np.inf)

    start, goal = np.array([-1.5, 0.0]), np.array([1.5, 0.0])
    way = Way(start, goal, np.full(2, -2.0), np.full(2, 2.0), np.ones(2), seed).look(margin, 60_000)
    assert way is not None
    assert (way[0] == start).all()
    assert (way[-1] == goal).all()
    dense = [a + t * (b - a) for a, b in pairwise(way) for t in np.linspace(0, 1, 300)]
    assert min(margin(p) for p in dense) >= -FLOOR / 2 - 1e-9


def test_what_has_no_way_is_looked_for_on_and_on() -> None:
    wall = Way(np.array([-1.0]), np.array([1.0]), np.array([-2.0]), np.array([2.0]), np.ones(1), 0)
    assert wall.look(lambda point: abs(float(point[0])) - 0.3, 500) is None
    assert wall.looked == 500


def test_no_point_of_a_robot_moves_more_than_its_levers_say() -> None:
    """Random pairs of near postures: the distance changes by no more than the levers allow, of every shipped arm."""
    rng = np.random.default_rng(3)
    so101 = profiles.load("so101")[0].models["arm"].robot
    for robot in (*ARMS.values(), so101):
        thing = {"rod": {"position": [0.3, 0.1, 0.3], "radius": 0.02, "length": 0.6}}
        apart = RobotDistances(robot, None, ReachDistancesConfig.model_validate({"obstacles": thing}))
        for _ in range(150):
            q = rng.uniform(np.maximum(robot.q_lower, -3.0), np.minimum(robot.q_upper, 3.0))
            step = rng.normal(0.0, 0.01, robot.n) * (rng.uniform(size=robot.n) < 0.4)
            change = abs(apart.margin(q + step) - apart.margin(q))
            assert change <= np.abs(step) @ apart.levers + 1e-9
