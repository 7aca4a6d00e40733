"""The extent that another clearance reads: it holds every place of the limb, and is None where that is unknown."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.guard import guard_of
from helpers.verified import DT, LAG, LIMITS, A, Scene

from srl.runtime.contracts.signals import Array, Kind, Stop

KINDS = pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
START = (-1.0, 0.5)
PLACE = np.array(START)
TIMEOUT = 0.05  # s
TRACKING = 0.01  # rad
LONGEST = 60  # cycles of a stop


def watched(kind: Kind, **options: Any) -> Scene:
    scene = Scene(kind, start=START, tracking=TRACKING, timeout=TIMEOUT, **options)
    scene.clearance.watched = True
    return scene


def extent(scene: Scene) -> tuple[Array, Array]:
    assert scene.clearance.extent is not None
    return scene.clearance.extent


def go(scene: Scene, k: int) -> None:
    """To and fro, each joint at times of its own."""
    way = np.array([np.sin(0.05 * k), np.cos(0.08 * k)])
    scene.step(PLACE + way if scene.guard.command.kind is Kind.POSITION else 1.5 * way)


@KINDS
def test_of_a_limb_at_rest_it_is_its_place_and_the_slack(kind: Kind) -> None:
    scene = watched(kind)
    for _ in range(20):
        scene.step(START if kind is Kind.POSITION else (0.0, 0.0))
    low, high = extent(scene)
    slack = TRACKING + (A * LAG * (LAG / 2 + DT) if kind is Kind.VELOCITY else 0.0)
    assert low == pytest.approx(PLACE - slack)
    assert high == pytest.approx(PLACE + slack)


@pytest.mark.parametrize(("kind", "jerk"), [(Kind.POSITION, None), (Kind.POSITION, 200.0), (Kind.VELOCITY, None)])
@pytest.mark.parametrize("late", [0, 3])
def test_the_limb_is_within_it_until_the_next_one_and_through_a_stop(kind: Kind, jerk: float | None, late: int) -> None:
    """It obeys as late as it may. A stop begins in one of the cycles."""
    for stop in range(5, 150, 7):
        scene = watched(kind, late=late, jerk=jerk)
        for k in range(stop):
            low, high = (PLACE, PLACE) if k == 0 else extent(scene)
            go(scene, k)
            if k:
                assert (low <= scene.at + 1e-9).all()
                assert (scene.at <= high + 1e-9).all()
        low, high = extent(scene)
        for _ in range(LONGEST):
            scene.stop(Stop.HOLD)
            assert (low <= scene.at + 1e-9).all()
            assert (scene.at <= high + 1e-9).all()


def test_a_position_that_nothing_measures_may_be_taken_a_period_of_the_link_later() -> None:
    """The limb obeys as late as the lag, the link's period and a cycle let it."""
    scene = watched(Kind.POSITION, late=round((LAG + 0.06 + DT) / DT), feedback=False, period=0.06)
    for k in range(150):
        low, high = (PLACE, PLACE) if k == 0 else extent(scene)
        go(scene, k)
        if k:
            assert (low <= scene.at + 1e-9).all()
            assert (scene.at <= high + 1e-9).all()


def test_of_positions_it_ends_where_the_stop_does_and_where_the_limb_was_within_lag_and_timeout() -> None:
    scene = watched(Kind.POSITION)
    commanded: list[Array] = []
    assert scene.guard.verified is not None
    span = LAG + scene.guard.verified.timeout
    for k in range(60):
        go(scene, k)
        commanded.append(scene.applied.copy())
        if k < 10:
            continue
        velocity = scene.guard.velocity.copy()
        T = (abs(velocity) / A).max()
        end = scene.applied + velocity * T / 2
        least, most = ([*commanded[-round(span / DT) - n :], end] for n in (1, 3))
        low, high = extent(scene)
        assert (low <= np.min(least, axis=0) - TRACKING + 1e-9).all()
        assert (high >= np.max(least, axis=0) + TRACKING - 1e-9).all()
        assert (low >= np.min(most, axis=0) - TRACKING - 1e-9).all()
        assert (high <= np.max(most, axis=0) + TRACKING + 1e-9).all()


@KINDS
@pytest.mark.parametrize("why", ["old", "nan"])
def test_where_the_limb_is_not_known_there_is_none(kind: Kind, why: str) -> None:
    scene = watched(kind)
    for k in range(30):
        go(scene, k)
    extent(scene)
    before = scene.at.copy()
    for _ in range(2):
        scene.guard.unmeasured = why == "old"
        if why == "nan":
            scene.at[1] = np.nan
        scene.look()
        scene.guard.stop(Stop.HOLD, DT)
        assert scene.clearance.extent is None
    scene.guard.unmeasured, scene.at[:] = False, before
    scene.look()
    scene.guard.stop(Stop.HOLD, DT)
    extent(scene)


@KINDS
def test_nobody_is_told_who_does_not_look(kind: Kind) -> None:
    scene = Scene(kind, start=START)
    for k in range(10):
        go(scene, k)
    assert scene.clearance.extent is None


def test_a_limb_that_is_commanded_by_positions_need_not_be_measured() -> None:
    scene = Scene(start=START)
    scene.guard = guard_of(Kind.POSITION, 2, DT, **LIMITS)
    scene.guard.bind(scene.applied)
    scene.guard.keep_clear(scene.clearance, LAG, np.full(2, TRACKING))
    scene.clearance.watched = True
    scene.guard.reset(PLACE)
    for _ in range(100):
        scene.step((-0.5, 0.2))
    assert scene.applied == pytest.approx([-0.5, 0.2])
    low, high = extent(scene)
    assert low == pytest.approx(scene.applied - TRACKING)
    assert high == pytest.approx(scene.applied + TRACKING)
