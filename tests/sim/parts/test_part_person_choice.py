"""The simulated person: how long reaches take, speeds along a path, pushes that grow, aim, knowledge of a handle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.person import alone, finished, go_to, guided, quiet, run
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from srl.sim.parts.person.intention import Intention
from srl.sim.parts.person.path import ArcPath
from srl.sim.parts.person.plans import Follow, Insert
from srl.sim.parts.person.vigour import duration, energy

STILL = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)
WIRE = ((0.0, 0.0, 1.0), (0.4, 0.0, 1.0))


def intention(plan: Any, **options: Any) -> Intention:
    made = Intention(
        plan,
        **{"speed": 0.25, "turn_speed": 1.0, "reaction": 0.0, "stiffness": 200.0} | options,
        find=lambda name: STILL,
        sites=lambda prefix: np.array(WIRE),
    )
    made.begin(STILL)
    return made


# -- reaches: effort and reward


@settings(max_examples=25)
@given(
    distance=st.floats(0.02, 1.0), load=st.floats(0.0, 8.0), drag=st.floats(0.0, 40.0), reward=st.floats(100.0, 500.0)
)
def test_a_reach_takes_the_time_that_is_worth_most(distance: float, load: float, drag: float, reward: float) -> None:
    found = duration(distance, 2.2, load, drag, reward)

    def worth(t: float) -> float:
        return (reward - energy(t, distance, 2.2, load, drag)) / (1.0 + t)

    times = np.geomspace(0.15, 20.0, 400)
    best = max(worth(t) for t in times)
    if best > 0:
        assert worth(found) >= best - 1e-6 * abs(best)
    else:
        least = minimize_scalar(lambda t: energy(t, distance, 2.2, load, drag), bounds=(0.15, 20.0), method="bounded")
        assert energy(found, distance, 2.2, load, drag) <= least.fun * (1 + 1e-6)


def test_heavy_things_and_drag_take_longer_and_rewards_hurry() -> None:
    free = duration(0.3, 2.2, 0.0, 0.0, 250.0)
    assert 0.7 < free < 1.0, "as people reach"
    assert free < duration(0.3, 2.2, 3.0, 0.0, 250.0) < duration(0.3, 2.2, 6.0, 40.0, 250.0)
    assert duration(0.3, 2.2, 0.0, 0.0, 400.0) < free


def test_a_reach_lasts_as_long_as_it_is_worth_unless_a_step_says_how_fast() -> None:
    asked = []

    def lasting(distance: float) -> float:
        asked.append(distance)
        return 2.0

    for speed, expected in ((None, 2.0), (0.5, 1.875 * 0.3 / 0.5)):
        mind = intention((go_to(0.3, 0.0, 1.0, speed=speed),), lasting=lasting)
        mind.update(0.0, 0.002, STILL, STILL, 0.0)
        assert mind.aim.length == pytest.approx(expected)
    assert asked == [pytest.approx(0.3)]


# -- paths: the steering law


def _led(step: Follow, off: float = 0.0, **options: Any) -> tuple[np.ndarray, Intention]:
    mind, speeds = intention((step,), **options), []
    for k in range(20000):
        mind.update(0.002 * k, 0.002, mind.aim.pose, mind.aim.pose, off)
        if mind.step is None:
            break
        speeds.append(float(np.linalg.norm(mind.aim.velocity)))
    return np.array(speeds), mind


@pytest.mark.parametrize(("off", "share"), [(0.0, 1.0), (0.006, 0.5), (0.009, 0.25)])
def test_speed_is_the_play_that_is_left_over_the_steering_constant(off: float, share: float) -> None:
    speeds, _ = _led(Follow(do="follow", points=WIRE, width=0.024), off, steering=0.2)
    assert speeds.max() == pytest.approx(share * 0.024 / 0.2, rel=0.02)


def test_without_a_known_play_the_step_says_the_speed() -> None:
    speeds, _ = _led(Follow(do="follow", points=WIRE, speed=0.07), steering=0.2)
    assert speeds.max() == pytest.approx(0.07, rel=0.02)


def test_a_bend_is_taken_as_fast_as_the_tool_can_be_turned() -> None:
    angle = np.linspace(0.0, np.pi, 60)
    bow = np.column_stack([0.05 * np.cos(angle) - 0.05, 0.05 * np.sin(angle), np.ones(60)])
    points = tuple(map(tuple, bow.tolist()))
    free, _ = _led(Follow(do="follow", points=points, width=0.024, turning=False))
    turned, _ = _led(Follow(do="follow", points=points, width=0.024, turning=True), turn_speed=1.0)
    assert free.max() > 0.15
    assert turned.max() < 0.06, "1 rad/s about 0.05 m, and a little more where the bend begins"


def test_what_turns_with_a_path_turns_without_jerks() -> None:
    path = ArcPath(np.array([(0, 0, 1.0), (0.1, 0, 1), (0.1, 0.1, 1), (0.2, 0.1, 1)]), (1.0, 0, 0, 0), turning=True)
    turns = np.array([path.at(s)[3:] for s in np.arange(0.0, path.length, 0.002)])
    rates = 2.0 * np.arccos(np.clip(np.abs((turns[1:] * turns[:-1]).sum(axis=1)), -1.0, 1.0)) / 0.002
    assert np.abs(np.diff(rates)).max() < 0.2 * rates.max()


# -- pushes


def _pushed(moves: bool, **options: Any) -> list[float]:
    step = Insert(do="insert", direction=(0, 0, -1), depth=0.05, force=15.0, speed=0.02, patience=6.0)
    mind, forces = intention((step,), reaction=0.25, **options), []
    for k in range(4000):
        t = 0.002 * k
        deep = min(max(t - 0.25, 0.0) * 0.02, 0.05) if moves else 0.0
        mind.update(t, 0.002, (0.0, 0.0, 1.0 - deep, 1.0, 0.0, 0.0, 0.0), STILL, 0.0)
        if mind.pushing is not None:
            forces.append(mind.pushing[1])
    return forces


def test_a_push_that_is_stalled_grows_and_one_that_moves_doesnt() -> None:
    grown = np.array(_pushed(moves=False, rise=10.0, most=40.0))
    assert grown[0] == 15.0
    assert grown.max() == pytest.approx(40.0)
    rising = grown[(grown > 16.0) & (grown < 39.0)]
    assert np.diff(rising) / 0.002 == pytest.approx(10.0, rel=1e-6)
    assert set(_pushed(moves=True, rise=10.0, most=40.0)) == {15.0}
    assert set(_pushed(moves=False)) == {15.0}


def test_a_tilted_person_pushes_askew() -> None:
    step = Insert(do="insert", direction=(0, 0, -1), depth=0.05, force=15.0)
    mind = intention((step,), toward=lambda d: (d[0] + 0.1, d[1], d[2]))
    mind.update(0.0, 0.002, STILL, STILL, 0.0)
    assert mind.pushing == ((0.1, 0.0, -1.0), 15.0)


# -- aim and knowledge


def test_who_aims_beside_ends_beside_by_that() -> None:
    ends = []
    for bias in ((0.0, 0.0, 0.0), (0.004, -0.003, 0.0)):
        world = alone([go_to(0.2, 0.1, 1.2)], **quiet(), aim_bias=bias)
        run(world, 6.0, until=finished)
        run(world, 2.0)
        ends.append(world.truth_arrays["person_tool"].copy())
    np.testing.assert_allclose(ends[1] - ends[0], [0.004, -0.003, 0.0], atol=3e-4)


def test_a_relative_reach_has_no_bias() -> None:
    mind = intention((go_to(0.3, 0.0, 1.0).model_copy(update={"position": None, "by": (0.1, 0.0, 0.0)}),))
    mind = Intention(
        mind.plan, speed=0.25, turn_speed=1.0, reaction=0.0, stiffness=200.0, beside=(0.01, 0.0, 0.0),
        find=lambda name: STILL, sites=lambda prefix: np.zeros((2, 3)),
    )  # fmt: skip
    mind.begin(STILL)
    mind.update(0.0, 0.002, STILL, STILL, 0.0)
    assert mind.aim.goal[0] == pytest.approx(0.1)


def test_who_doesnt_know_a_handle_lags_behind_the_plan() -> None:
    lags = []
    for knowledge in (1.0, 0.3):
        world = guided([go_to(0.4, 0.0, 1.0)], **quiet(), knowledge=knowledge)
        found = run(world, 3.0, every=4)
        lags.append(float(np.abs(found["person_aim"] - found["person_tool"]).max()))
    assert lags[1] > 1.5 * lags[0]
