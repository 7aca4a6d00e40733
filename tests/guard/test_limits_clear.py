"""Position limits under a clearance: the joints brake together, which takes one of them farther than braking alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.verified import DT, LAG, A, Scene, V, points, wanted
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Kind, Stop

KINDS = pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
UPPER = 0.4  # rad, of the second joint; the first is slow to brake and has room
TIGHT: dict[str, Any] = {"lower": [-9.0, -UPPER], "upper": [9.0, UPPER]}
TIMEOUT = 0.02  # s
LONGEST = int(np.ceil(V / A.min() / DT)) + 1  # cycles of a stop


def drive(scene: Scene, side: float, seen: bool = True) -> None:
    """A cycle at full speed in the first joint, and towards its limit in the second."""
    position = scene.guard.command.kind is Kind.POSITION
    scene.step((9.0, side * (UPPER - 0.01)) if position else (V, side * V), seen)


def beyond(scene: Scene) -> float:
    """rad, by which the second joint is past its limit."""
    return float(abs(scene.at[1]) - UPPER)


@KINDS
@pytest.mark.parametrize("ends", ["a stop", "the disc", "the disc isn't seen"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_however_the_motion_ends_no_joint_passes_its_limit(kind: Kind, ends: str, side: float) -> None:
    """At full speed the first joint needs 1/3 s to stop, the second alone half of that.

    A velocity is obeyed as late as it may be: by the lag, and the time-out for which a device goes on by itself.
    """
    late = round((LAG + TIMEOUT) / DT) if kind is Kind.VELOCITY else 0
    for cycles in range(14, 44, 3):
        scene = Scene(kind, start=(0.0, -0.3 * side), late=late, timeout=TIMEOUT, **TIGHT)
        for _ in range(cycles):
            drive(scene, side)
        if ends == "the disc":
            scene.disc[:] = 0.2 * np.cos(scene.at[0]), 0.2 * np.sin(scene.at[0])
        for _ in range(LONGEST + late):
            if ends == "a stop":
                scene.stop(Stop.HOLD)
            else:
                drive(scene, side, seen=ends == "the disc")
            assert beyond(scene) <= 1e-9
        assert not scene.guard.velocity.any() or ends == "the disc"  # it may creep out of that


@KINDS
@given(pieces=st.lists(st.tuples(wanted, points, st.integers(5, 40)), min_size=1, max_size=5), late=st.integers(0, 3))
@settings(deadline=None)
def test_limits_hold_for_any_demand_with_the_disc_anywhere(kind: Kind, pieces: Any, late: int) -> None:
    scene = Scene(kind, late=late, lower=-UPPER, upper=UPPER)
    for desired, centre, cycles in pieces:
        scene.disc[:] = centre
        for _ in range(cycles):
            scene.step(desired)
            assert (abs(scene.at) <= UPPER + 1e-9).all()
    for _ in range(LONGEST + late):
        scene.stop()
        assert (abs(scene.at) <= UPPER + 1e-9).all()


@KINDS
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_with_room_for_the_stop_nothing_is_held_back(kind: Kind, side: float) -> None:
    """Alone, and in the middle of its range, it goes as without a clearance; and it comes to its limit."""
    scene = Scene(kind, start=(0.0, -0.3 * side), **TIGHT)
    for _ in range(10):
        drive(scene, side)
        assert not scene.held
        assert scene.guard.velocity @ [1.0, side] > 0
    assert abs(scene.guard.velocity) == pytest.approx(np.minimum(10 * A * DT, V), rel=0.01)
    for _ in range(200):
        drive(scene, side)
    assert -0.05 < beyond(scene) <= 1e-9
