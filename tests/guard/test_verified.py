"""The verified stop: when it holds a limb, when it lets it go on, and the limits that it keeps."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.guard import PLACE, guard_of
from helpers.planar import REACH
from helpers.verified import DT, LAG, A, C, Scene, points, slow, wanted
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Kind


@given(st.lists(st.tuples(wanted, points, slow), min_size=1, max_size=8), st.sampled_from([0, 3]))
@settings(max_examples=40, deadline=None)
def test_the_limits_hold_and_the_command_never_jumps(pieces, late):
    scene = Scene(late=late)
    p, v = scene.applied.copy(), scene.guard.velocity.copy()
    for desired, centre, speed in pieces:
        scene.disc[:], scene.speed[:] = centre, speed
        for _ in range(20):
            scene.step(desired)
            q, u = scene.applied, scene.guard.velocity
            assert (abs(u - v) <= A * DT * (1 + 1e-6)).all()
            assert (abs(q - p - DT * (u + v) / 2) <= A * DT * DT / 4 * (1 + 1e-6)).all()
            assert (abs(q) <= 3 + 1e-9).all()
            p, v = q.copy(), u.copy()


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_it_stops_before_a_disc_in_its_way_and_goes_on_when_that_is_gone(kind):
    scene = Scene(kind, start=(-1.0, 0.0))
    scene.disc[:] = 0.5, 0.0

    def go() -> None:
        scene.step((1.0, 0.0) if kind is Kind.POSITION else (0.8 if scene.at[0] < 1.0 else 0.0, 0.0))

    for _ in range(300):
        go()
        assert scene.clearest() >= C
    assert scene.held
    assert scene.guard.limited
    assert scene.clearest() < 0.06, "it comes as near as it may"
    assert not scene.guard.velocity.any()
    stopped = scene.at.copy()
    scene.disc[:] = 9.0
    go()
    assert 0 < scene.at[0] - stopped[0] <= A[0] * DT * DT * (1 + 1e-9)
    for _ in range(300):
        go()
    assert scene.at[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
@pytest.mark.parametrize("lost", ["missing", "old", "nan", "error"])
def test_without_good_data_it_comes_to_rest_and_goes_on_with_it(kind, lost, monkeypatch):
    scene = Scene(kind, start=(-1.0, 0.0))
    desired = (1.0, 0.5) if kind is Kind.POSITION else (0.8, 0.2)
    for _ in range(40):
        scene.step(desired)
    assert scene.guard.velocity.all()
    before = scene.guard.velocity.copy()
    if lost == "old":
        scene.age = 0.6
    if lost == "nan":
        scene.disc[:] = np.nan
    if lost == "error":
        monkeypatch.setattr(scene.clearance, "clear", lambda motion: 1 / 0)
    for _ in range(int(np.ceil(max(abs(before) / A) / DT)) + 1):
        scene.step(desired, seen=lost != "missing")
        assert scene.held
        assert scene.guard.velocity @ before >= 0
    assert not scene.guard.velocity.any()
    assert scene.guard.verified is not None
    assert ("ZeroDivisionError" if lost == "error" else "the disc isn't seen") in scene.guard.verified.why
    assert np.isnan(scene.guard.verified.margin)
    scene.age, scene.disc[:] = 0.02, 9.0
    monkeypatch.undo()
    scene.step(desired)
    assert not scene.held
    assert scene.guard.velocity.any()


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_a_limb_at_rest_too_near_to_something_is_not_held_and_one_that_wants_to_move_is_counted(kind):
    scene = Scene(kind)
    scene.disc[:] = 0.3, 0.09
    assert scene.guard.verified is not None
    for _ in range(5):
        scene.step((0.0, 0.0))
        assert not scene.held
        assert scene.guard.verified.margin < 0
    assert scene.guard.verified.holds == 0
    for k in range(1, 4):
        scene.step((0.5, 0.0))
        assert scene.held
        assert scene.guard.verified.holds == k


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_a_limb_at_rest_needs_nobodys_leave_where_nothing_is_seen(kind):
    scene = Scene(kind)
    for _ in range(5):
        scene.step((0.0, 0.0), seen=False)
        assert not scene.held
    scene.step((0.5, 0.0), seen=False)
    assert scene.held
    assert not scene.guard.velocity.any()


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_before_the_first_look_nothing_moves(kind):
    scene = Scene(kind)
    for _ in range(3):
        scene.guard.step(np.array([0.5, 0.5]), None, DT)
        assert scene.held
        assert not scene.guard.velocity.any()


def test_a_limb_that_is_too_near_may_creep_away_and_nothing_else():
    scene = Scene(start=(0.0, 0.0))
    scene.disc[:] = 0.3, 0.09  # 0.01 m from the first link, to its left
    scene.step((0.5, 0.0))
    assert scene.held
    assert not scene.guard.velocity.any()
    gap = scene.clearest()
    for _ in range(50):
        scene.step((-1.0, 0.0))
        assert not scene.held
        assert np.abs(scene.guard.velocity) @ REACH.max(axis=1) <= 0.02 + 1e-9 or scene.clearance.margin >= 0
        assert scene.clearest() >= gap
        gap = scene.clearest()
    for _ in range(800):
        scene.step((-1.0, 0.0))
    assert scene.at[0] == pytest.approx(-1.0, abs=1e-3), "once it is clear it goes at full speed"


@pytest.mark.parametrize("late", [1, 5])
def test_a_limb_that_is_too_near_creeps_in_steps_that_begin_and_end_at_rest_too(late):
    """A client may ask for steps with no velocity of their own: each is within the acceleration, all are a motion."""
    scene, dt = Scene(), late * DT
    scene.disc[:] = 0.3, 0.09
    moved = False
    for _ in range(30):
        before = scene.at.copy()
        scene.look()
        scene.guard.step(before - A * dt * dt / 4 * 0.99, np.zeros(2), dt)
        scene.at[:] = scene.applied
        assert np.abs(scene.at - before) / dt @ REACH.max(axis=1) <= 0.02 + 1e-9 or scene.clearance.margin >= 0
        moved |= bool((scene.at != before).any())
    assert moved


def test_a_limb_that_was_pushed_aside_doesn_t_creep_into_what_pushed_it():
    """Its command is on one side of the disc, the limb on the other: away for one is nearer for the other."""
    scene = Scene()
    for _ in range(5):
        scene.step((0.0, 0.0))
    pushed = np.array([0.62, 0.0])
    scene.disc[:] = 0.3 * np.cos(0.3), 0.3 * np.sin(0.3)
    for _ in range(100):
        scene.at[:] = pushed
        scene.step((-1.0, 0.0))
        assert scene.held
    assert not scene.applied.any()
    scene.disc[:] = 0.3 * np.cos(0.45), -0.3 * np.sin(0.45)  # now it is on the other side of both
    for _ in range(100):
        scene.at[:] = pushed + scene.applied
        scene.step((1.0, 0.0))
    assert scene.applied[0] > 0.01


def test_a_torque_and_a_velocity_without_its_positions_are_refused():
    torque = guard_of(Kind.TORQUE, 2, velocity=1.0, effort=1.0, effort_rate=10.0, inertia=1.0)
    judge = Scene().clearance
    with pytest.raises(WiringError, match="how the limb brakes"):
        torque.keep_clear(judge, LAG, np.zeros(2))
    velocity = guard_of(Kind.VELOCITY, 2, velocity=1.0, acceleration=1.0)
    velocity.bind(np.zeros(2))
    with pytest.raises(WiringError, match=f"{PLACE}.*positions"):
        velocity.keep_clear(judge, LAG, np.zeros(2), 0.1)
    velocity.bind(np.zeros(2), np.zeros(2))
    with pytest.raises(WiringError, match=r"until its device ends it.*nothing says when"):
        velocity.keep_clear(judge, LAG, np.zeros(2))
