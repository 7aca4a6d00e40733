"""What a way costs: `arm-reach` and `reach` against OMPL's RRT-Connect with the same margins, and what a posture costs.

Each problem of `arm-reach` is a Panda that goes from one random free posture to another past a post and a board; one
of `reach` is the worn arm of human-srl beside a wearer who stands still. Both planners ask the same function for the
margin of postures; `reach` asks for those of an edge at once. OMPL judges edges at a fixed resolution, as its own
default would (1 % of the space's extent); it is stopped at 5 s. Simulated.
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
from srl.control.reach.connect import Connect
from srl.control.reach.options import ReachConfig
from srl.control.reach.rest_margin import RestMargin
from srl.control.reach.static import Way
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA
from srl.runtime.profile import profile
from srl.sim.parts.body.motion import Scripted

_ID: Final = "reach"
_PROBLEMS: Final = 40
_OMPL: Final = "OMPL RRT-Connect"
_MOST: Final = 200_000  # postures
_TURNS: Final = 2000  # of `reach`'s search
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


@cache
def _worn() -> tuple[RestMargin, ReachConfig, tuple[tuple[Array, Array], ...]]:
    """The margins beside a still wearer, the law's options, and pairs of free postures as in `_scene`."""
    (entry,) = (each for each in profile.load("human-srl", ["motion=reach"])[0].controllers if each.use == "reach")
    options = ReachConfig.model_validate(entry.options)
    rest, ranges = RestMargin(options), options.ranges
    suit = Skeleton("axis-neuron")
    places = suit.offsets.copy()
    script = Scripted("reach", suit, 1.0, 1, "wearer")
    for k in range(20):
        places[0], turns = script.at(1e-9 * k)
        rest.see(turns, places, 1 / 60)
    rng, made = np.random.default_rng(1), list[tuple[Array, Array]]()
    while len(made) < _PROBLEMS:
        start, goal = rng.uniform(ranges.q_lower, ranges.q_upper, (2, ranges.n))
        line = start + np.linspace(0.0, 1.0, 60)[:, None] * (goal - start)
        margin = rest.margins(line)
        if margin[0] > 0.0 and margin[-1] > 0.0 and margin.min() < 0.0:
            made.append((start, goal))
    return rest, options, tuple(made)


def _connected(start: Array, goal: Array, seed: int) -> bool:
    rest, options, _ = _worn()
    ranges = options.ranges
    scale = ranges.dq_max
    search = Connect(
        start / scale, goal / scale, ranges.q_lower / scale, ranges.q_upper / scale,
        lambda points: rest.margins(points * scale) >= 0.0, seed,
    )  # fmt: skip
    return any(search.grow() is not None for _ in range(_TURNS))


def _ompl_worn(start: Array, goal: Array, seed: int) -> bool:
    rest, options, _ = _worn()
    ranges = options.ranges
    return _by_ompl(start, goal, ranges.q_lower, ranges.q_upper, lambda q: bool(rest.margins(q[None])[0] >= 0.0))


def _ways(plan: Callable[[Array, Array, int], bool], problems: tuple[tuple[Array, Array], ...]) -> dict[str, float]:
    """ms of the processor for each problem; one that isn't solved counts as the longest."""
    took = []
    for seed, (start, goal) in enumerate(problems):
        before = clock()
        plan(start, goal, seed)
        took.append((clock() - before) / 1e6)
    return {f"p{share}": float(np.percentile(took, share)) for share in (50, 90, 99)}


def _ours(start: Array, goal: Array, seed: int) -> bool:
    apart, scale = _scene()[0], PANDA.dq_max
    levers = apart.levers * scale
    way = Way(start / scale, goal / scale, PANDA.q_lower / scale, PANDA.q_upper / scale, levers, seed)
    return way.look(lambda point: apart.margin(point * scale), _MOST) is not None


def _ompl(start: Array, goal: Array, seed: int) -> bool:
    apart = _scene()[0]
    return _by_ompl(start, goal, PANDA.q_lower, PANDA.q_upper, lambda q: apart.margin(q) >= 0.0)


def _by_ompl(start: Array, goal: Array, lower: Array, upper: Array, free: Callable[[Array], bool]) -> bool:
    n = len(lower)
    space = base.RealVectorStateSpace(n)
    bounds = base.RealVectorBounds(n)
    for i in range(n):
        bounds.setLow(i, float(lower[i]))
        bounds.setHigh(i, float(upper[i]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: free(np.array([state[i] for i in range(n)])))
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
    problems = _scene()[1]
    ways = measure(partial(_ways, _ours, problems), {_OMPL: partial(_ways, _ompl, problems)})
    what = f"CPU for a way of a Panda past two things ({_PROBLEMS} problems, no straight one is free)"
    rows = [ways.row(_ID, f"{what}, {figure}", figure, _OMPL, "ms") for figure in ("p50", "p90")]
    worn = _worn()[2]
    ways = measure(partial(_ways, _connected, worn), {_OMPL: partial(_ways, _ompl_worn, worn)})
    what = f"CPU for a way of `reach` beside a still wearer ({_PROBLEMS} problems, no straight one is free)"
    rows += [ways.row(_ID, f"{what}, {figure}", figure, _OMPL, "ms") for figure in ("p50", "p90", "p99")]
    apart = _scene()[0]

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
