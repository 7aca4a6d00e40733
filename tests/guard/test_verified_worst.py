"""The verified stop against a disc doing its worst: what is accepted can be stopped from before the disc is near."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.planar import REACH, distances
from helpers.verified import A_H, DT, LAG, A, C, Scene, points, slow, wanted
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Array, Kind
from srl.runtime.guard.base import PROMPT
from srl.runtime.guard.verified import brake_together, stop_time


def worst(
    scene: Scene, states: list[tuple[float, float, float]], before: Array, push: Array, stall: float = 0.0
) -> float:
    """The least distance while the arm brakes from `states`, and the disc accelerates as much as it may.

    stall: s, by which the loop's next cycle is late.

    Every millisecond: the arm is where its command was LAG ago, or where the command is, whichever is nearer.
    """
    A_, J = A.tolist(), [np.inf, np.inf]
    T, step = stop_time([v for _, v, _ in states], A_), 0.001
    n = int(np.ceil((DT + stall + T + LAG) / step)) + 1
    command = []
    for t in np.arange(n) * step:
        if t < DT:
            command.append(before + (np.array([p for p, _, _ in states]) - before) * t / DT)
        else:
            late = max(t - DT - stall, 0.0)
            command.append(np.array([p for p, _, _ in brake_together(states, A_, J, late)]))
    lag = round(LAG / step)
    late = [before] * lag + command[: n - lag]
    centre, speed, least = scene.disc.copy(), scene.speed.copy(), np.inf
    for k in range(-int(scene.age / step), n):  # the disc moves since it was seen
        if k >= 0:
            least = min(least, distances(np.array([command[k], late[k]]), centre)[0].min())
        centre, speed = centre + step * speed + 0.5 * step * step * A_H * push, speed + step * A_H * push
    return float(least)


TRIALS = (
    st.lists(st.tuples(wanted, points, slow), min_size=1, max_size=5),
    st.floats(0, 0.08),
    st.integers(0, 2**32 - 1),
)


@pytest.mark.slow
@given(*TRIALS)
@settings(max_examples=6, deadline=None, phases=[Phase.generate])
def test_whatever_was_accepted_can_be_stopped_from_before_the_disc_is_near(pieces, age, seed):
    stoppable(pieces, age, seed)


@pytest.mark.slow
@pytest.mark.exhaustive
@given(*TRIALS)
@settings(max_examples=50, deadline=None, phases=[Phase.generate])
def test_whatever_was_accepted_can_be_stopped_in_many_more_trials(pieces, age, seed):
    stoppable(pieces, age, seed)


def stoppable(pieces, age, seed):
    """The arm may be anywhere between its command and LAG behind it; the disc heads for it as hard as it can."""
    rng = np.random.default_rng(seed)
    scene = Scene(age=age)
    for desired, centre, speed in pieces:
        scene.disc[:], scene.speed[:] = centre, speed
        if scene.clearest() < C:
            scene.disc[:] = 9.0
        for _ in range(15):
            before = scene.applied.copy()
            scene.step(desired)
            states = scene.guard._states
            if scene.held or scene.guard.verified.margin < 0 or not scene.guard.velocity.any():
                continue
            middle = np.array([0.3 * np.cos(before[0]), 0.3 * np.sin(before[0])])
            way = middle - scene.disc
            turn = rng.normal(size=2)
            for aim in (way / np.linalg.norm(way), turn / np.linalg.norm(turn)):
                for stall in (0.0, (PROMPT - 1) * DT):
                    assert worst(scene, states, before, aim, stall) >= C - 1e-6


@pytest.mark.slow
@given(
    st.sampled_from([Kind.POSITION, Kind.VELOCITY]), st.sampled_from([None, 150.0]), st.sampled_from([0.0, 0.1]),
    st.integers(0, 2**32 - 1),
)  # fmt: skip
@settings(max_examples=30, deadline=None, phases=[Phase.generate])
def test_no_disc_within_its_acceleration_meets_an_arm_that_moves(kind, jerk, stalls, seed):
    """It hunts the arm, seen 20 ms late; the arm obeys 30 ms late. What is nearer than C finds the arm at rest, or
    creeping. A share of the cycles comes up to five periods late: the disc goes on meanwhile."""
    rng = np.random.default_rng(seed)
    scene = Scene(kind, start=(-2.0, 0.5), late=3, age=0.02, jerk=jerk)
    disc, speed, seen = rng.uniform(-0.8, 0.8, 2), np.zeros(2), []
    if distances(scene.at[None], disc)[0].min() < 0.1:
        disc += 2.0
    goal, hunts, moved, late = scene.at.copy(), True, 0, 0
    for k in range(300):
        if k % 50 == 0:
            goal, hunts = rng.uniform(-2.5, 2.5, 2), rng.random() < 0.7
        seen.append((disc.copy(), speed.copy()))
        before, near = scene.at.copy(), distances(scene.at[None], disc)
        if late < 4 and rng.random() < (0.7 if late else stalls):
            late += 1
            scene.wait()
        else:
            scene.disc[:], scene.speed[:] = seen[max(k - 2, 0)]
            scene.step(goal if kind is Kind.POSITION else np.clip(3 * (goal - scene.at), -1.5, 1.5), late=late)
            late = 0
        push = near[1][0, near[0][0].argmin()] if hunts else rng.normal(size=2)
        if np.linalg.norm(speed) > 1.2:
            push = -speed  # so fast is no limb
        push = push / max(np.linalg.norm(push), 1e-9)
        disc, speed = disc + DT * speed + 0.5 * DT * DT * A_H * push, speed + DT * A_H * push
        quick = np.abs(scene.at - before) / DT @ REACH
        gap = np.minimum(near[0][0], distances(scene.at[None], disc)[0][0])
        assert ((quick <= 0.02 + 1e-6) | (gap >= C - 1e-6)).all(), (k, quick, gap)
        moved += bool(quick.max() > 0.1)
    assert moved > 0


@given(wanted, points, slow, st.floats(0.0, 0.4), st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None, phases=[Phase.generate])
def test_a_loop_that_dies_leaves_a_velocity_that_ends_before_the_disc_is_near(goal, centre, speed, timeout, seed):
    """The device goes on until its time-out and then brakes as the guard would, while the disc heads for the arm."""
    rng = np.random.default_rng(seed)
    scene = Scene(Kind.VELOCITY, start=(-1.0, 0.3), timeout=timeout)
    scene.disc[:], scene.speed[:] = centre, speed
    if scene.clearest() < C:
        scene.disc[:] = 9.0
    for _ in range(int(rng.integers(5, 60))):
        scene.step(np.clip(3 * (np.array(goal) - scene.at), -1.5, 1.5))
    if scene.held or scene.clearance.margin < 0 or not scene.applied.any():
        return
    way = scene.at - scene.disc
    push, centre_, speed_ = way / np.linalg.norm(way), scene.disc.copy(), scene.speed.copy()
    at, v, step = scene.at - DT * scene.applied, scene.applied.copy(), 0.001
    for k in range(-round(scene.age / step), round((timeout + 1.0) / step)):
        if k >= 0:
            T = stop_time(v.tolist(), A.tolist())
            if k * step > timeout:
                v = v * max(1 - step / T, 0.0) if T > 0 else v
            at = at + step * v
            assert distances(at[None], centre_)[0].min() >= C - 1e-3
            if not v.any():
                break
        centre_, speed_ = centre_ + step * speed_ + 0.5 * step * step * A_H * push, speed_ + step * A_H * push
