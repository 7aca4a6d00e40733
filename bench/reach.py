"""What a way costs: `arm-reach` against OMPL's RRT-Connect with the same distances, and what a posture costs.

Each problem is a Panda that goes from one random free posture to another past a post and a board. Both planners ask the
same function for the margin of a posture. OMPL judges edges at a fixed resolution, as its own default would (1 % of the
space's extent); it is stopped at 5 s. Simulated.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final

import numpy as np
from ompl import base, geometric, util

from bench.collision import clock
from bench.pairs import Row, measure
from srl.control.cobot.robot_distances import RobotDistances
from srl.control.reach.arm_options import ReachDistancesConfig
from srl.control.reach.static import Way
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA

_ID: Final = "reach"
_PROBLEMS: Final = 40
_OMPL: Final = "OMPL RRT-Connect"
_MOST: Final = 200_000  # postures
_THINGS: Final = {
    "post": {"position": (0.45, 0.0, 0.4), "radius": 0.06, "length": 0.8},
    "board": {"position": (0.0, 0.5, 0.5), "size": (0.4, 0.1, 0.6)},
}


util.RNG.setSeed(1)
util.noOutputHandler()


@cache
def _scene() -> tuple[RobotDistances, tuple[tuple[Array, Array], ...]]:
    """The distances, and pairs of free postures whose straight way isn't free."""
    apart = RobotDistances(PANDA, None, ReachDistancesConfig.model_validate({"obstacles": _THINGS}))
    rng, made = np.random.default_rng(1), list[tuple[Array, Array]]()

    def free() -> Array:
        while True:
            q = rng.uniform(PANDA.q_lower, PANDA.q_upper)
            if apart.margin(q) > 0.0:
                return q

    while len(made) < _PROBLEMS:
        start, goal = free(), free()
        if min(apart.margin(start + t * (goal - start)) for t in np.linspace(0, 1, 60)) < 0.0:
            made.append((start, goal))
    return apart, tuple(made)


def _ways(plan: Callable[[Array, Array, int], bool]) -> dict[str, float]:
    """ms of the processor for each problem; one that isn't solved counts as the longest."""
    took = []
    for seed, (start, goal) in enumerate(_scene()[1]):
        before = clock()
        plan(start, goal, seed)
        took.append((clock() - before) / 1e6)
    return {"p50": float(np.median(took)), "p90": float(np.quantile(took, 0.9))}


def _ours(start: Array, goal: Array, seed: int) -> bool:
    apart, scale = _scene()[0], PANDA.dq_max
    levers = apart.levers * scale
    way = Way(start / scale, goal / scale, PANDA.q_lower / scale, PANDA.q_upper / scale, levers, seed)
    return way.look(lambda point: apart.margin(point * scale), _MOST) is not None


def _ompl(start: Array, goal: Array, seed: int) -> bool:
    apart, n = _scene()[0], PANDA.n
    space = base.RealVectorStateSpace(n)
    bounds = base.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, float(PANDA.q_lower[i]))
        bounds.setHigh(i, float(PANDA.q_upper[i]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: apart.margin(np.array([state[i] for i in range(n)])) >= 0.0)
    states = []
    for q in (start, goal):
        state = space.allocState()
        for i in range(n):
            state[i] = float(q[i])
        states.append(state)
    setup.setStartAndGoalStates(*states)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    return bool(setup.solve(5.0)) and bool(setup.haveExactSolutionPath())


def run() -> list[Row]:
    """Ways, then the price of a posture."""
    ways = measure(partial(_ways, _ours), {_OMPL: partial(_ways, _ompl)})
    what = f"CPU for a way of a Panda past two things ({_PROBLEMS} problems, no straight one is free)"
    rows = [ways.row(_ID, f"{what}, {figure}", figure, _OMPL, "ms") for figure in ("p50", "p90")]
    apart, problems = _scene()

    def postures() -> dict[str, float]:
        before = clock()
        for start, goal in problems:
            apart.margin(start)
            apart.margin(goal)
        return {"p50": (clock() - before) / 2e3 / len(problems)}

    period: dict[str, Any] = {"p50": 10_000.0}
    price = measure(postures, {"a period of 10 ms": lambda: period})
    what = f"a posture of `arm-reach` ({len(apart.pairs)} pairs)"
    return [*rows, price.row(_ID, what, "p50", "a period of 10 ms", "us")]
