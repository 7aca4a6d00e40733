"""The verified stop goes along the path that was checked, whatever makes the limb stop."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.verified import DT, LAG, A, C, Scene, V
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.signals import Kind, Stop
from srl.runtime.guard.base import LONGEST, PROMPT
from srl.runtime.guard.verified import brake_together


def judged(scene: Scene) -> list[Braking]:
    """Keeps a copy of each motion that the clearance is asked about from now on; the newest is the last."""
    kept, judge = list[Braking](), scene.clearance.clear

    def keep(motion: Braking) -> bool:
        kept.append(Braking(motion.path.copy(), motion.until.copy(), motion.velocity.copy(), motion.slack.copy()))
        return judge(motion)

    scene.clearance.clear = keep  # type: ignore[method-assign]
    return kept


def test_a_stop_leaves_the_line_neither_when_held_nor_when_told_to():
    """Without a clearance the joint with less to brake stops first, and the limb leaves its path."""
    off = {}
    for clear in (True, False):
        off[clear] = 0.0
        scene = Scene()
        if not clear:
            scene.guard.verified = None
        start, way = np.zeros(2), np.array([1.0, 0.2])
        scene.guard.reset(start)
        for k in range(40):
            if clear:
                scene.look()
            scene.guard.step(start + way * 0.5 * ((k + 1) / 40) ** 2, None, DT)
        assert scene.guard.velocity[0] > 0.5
        begin, direction = scene.applied.copy(), scene.guard.velocity / np.linalg.norm(scene.guard.velocity)
        while not scene.guard.at_rest:
            scene.guard.stop(Stop.HOLD, DT)
            gone = scene.applied - begin
            off[clear] = max(off[clear], float(np.linalg.norm(gone - gone @ direction * direction)))
    assert off[True] < 1e-12
    assert off[False] > 1e-3


@pytest.mark.parametrize(("timeout", "measured"), [(0.02, 0.0), (0.3, 0.0), (0.02, 0.04)])
def test_a_velocity_is_checked_as_if_the_loop_came_late_or_not_at_all(timeout, measured):
    """The limb goes on at what it was told, until the loop is back or the device ends it by itself; then it brakes.

    Where it was measured some time ago, it has gone on since.
    """
    scene = Scene(Kind.VELOCITY, start=(-1.0, 0.0), timeout=timeout, measured=measured)
    seen = judged(scene)
    for _ in range(30):
        scene.step((0.5, 0.1))
    at, late = scene.at - DT * scene.applied, max(LONGEST * DT, timeout)
    path, until, obeys = seen[-1].path, seen[-1].until, measured + LAG
    assert path[:4] == pytest.approx(at + np.outer([0.0, obeys, obeys + DT, obeys + DT + late], scene.applied))
    assert until[1:4] == pytest.approx([LAG, LAG + DT, LAG + DT + late])


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_the_stop_that_is_carried_out_is_the_one_that_was_checked(kind):
    """In its places, and in the time until which the limb may be on its way to each."""
    scene = Scene(kind, start=(-1.0, 0.0))
    seen = judged(scene)
    for _ in range(40):
        scene.step((1.0, 0.5) if kind is Kind.POSITION else (1.2, 0.7))
    checked, velocity = seen[-1], scene.guard.velocity.copy()
    assert not scene.held
    T = (abs(velocity) / A).max()
    begin = checked.path[-1] - velocity * T / 2
    if kind is Kind.POSITION:
        assert begin == pytest.approx(scene.applied)
    stop = [p for p in range(len(checked.path)) if checked.path[p] == pytest.approx(begin)][-1]
    path, times = checked.path[stop:], checked.until[stop:] - checked.until[stop]
    assert times[-1] == pytest.approx(T)
    assert len(path) >= 10
    assert (np.abs(np.diff(path, axis=0)) @ [0.55, 0.25]).max() <= 0.0101, "a limb moves by 0.01 m between samples"
    assert path == pytest.approx(begin + np.outer(times - times**2 / (2 * T), velocity))
    if kind is Kind.POSITION:
        for _ in range(round(T / DT) + 2):
            scene.stop()
        assert scene.applied == pytest.approx(checked.path[-1])


def test_retract_is_checked_too():
    scene = Scene(start=(-1.0, 0.0))
    scene.guard.rest = [1.0, 0.0]
    scene.disc[:] = 0.5, 0.0
    for _ in range(400):
        scene.stop(Stop.RETRACT)
        assert scene.clearest() >= C
        assert not scene.guard.at_rest
    assert scene.held
    scene.disc[:] = 9.0
    for _ in range(600):
        scene.stop(Stop.RETRACT)
    assert scene.guard.at_rest


def test_with_a_bounded_jerk_the_stop_that_is_carried_out_is_the_one_that_was_checked():
    scene = Scene(start=(-1.0, 0.0), jerk=200.0)
    seen = judged(scene)
    for _ in range(40):
        scene.step((1.0, 0.5))
    checked = seen[-1]
    assert not scene.held
    times = checked.until[1:] - LAG - PROMPT * DT
    at = [scene.applied.copy()]
    for _ in range(round(times[-1] / DT) + 2):
        scene.stop()
        at.append(scene.applied.copy())
    for i in range(2):
        planned = np.interp(DT * np.arange(len(at)), times, checked.path[1:, i])
        assert planned == pytest.approx(np.array(at)[:, i], abs=1e-3)


@given(st.lists(st.tuples(st.floats(-V, V), st.floats(-V, V)), min_size=1, max_size=20), st.floats(0, 0.3))
@settings(deadline=None)
def test_the_rest_of_a_stop_is_the_stop_of_the_rest(speeds, t):
    for v in speeds:
        states = [(0.1, v[0], 0.0), (-0.2, v[1], 0.0)]
        whole = brake_together(states, A.tolist(), [np.inf] * 2, t + 0.07)
        parts = brake_together(brake_together(states, A.tolist(), [np.inf] * 2, t), A.tolist(), [np.inf] * 2, 0.07)
        assert np.array(whole)[:, :2] == pytest.approx(np.array(parts)[:, :2], abs=1e-12)
