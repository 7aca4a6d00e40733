"""The observer counts what the hand and the robot really exchanged: leaning is free, giving energy isn't."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.admittance import admittance

DT = 2e-3


def test_a_lean_of_ten_seconds_on_a_wall_costs_nothing() -> None:
    """A robot that goes up to a wall, is leaned on it with 30 N, and then led away: as fast as if nothing had been."""
    controller = admittance(modes=(1, 0, 0, 0))
    x, wall, speeds = 0.0, 0.1, []
    rng = np.random.default_rng(3)
    for k in range(round(13.0 / DT)):
        push = 30.3 if k * DT < 11.0 else -30.3
        controller.input["wrench"][0] = push + rng.normal(0.0, 0.3)
        controller.update(DT)
        ahead = min(controller.output["pose"][0].item(), wall)
        controller.input["twist"][0] = (ahead - x) / DT + rng.normal(0.0, 0.002)
        controller.input["pose"][0] = x = ahead
        if k * DT > 11.0:
            speeds.append((ahead, controller.output["twist"][0].item()))
    away = [-v for ahead, v in speeds if ahead < wall]
    assert away[round(0.7 / DT)] > 0.98 * 0.75  # 30 N over 40 N s/m
    assert controller.metrics()["damped_cycles"] == 0


@pytest.mark.parametrize("age", [0.0, 0.02])
def test_the_tank_is_what_the_hand_put_in_and_may_get_back(age: float) -> None:
    """At most its size and the motion's energy above it; no less than nothing without a brake."""
    controller = admittance(modes=(1, 0, 0, 0), dead_band=(0.0, 0.0), leash=None, force_age=age, brake=1e-6)
    rng = np.random.default_rng(4)
    level, old = 0.1, [np.zeros(3)] * (round(age / DT) + 1)
    for k in range(2000):
        if k % 20 == 0:
            force, v = rng.normal(0, 5, 3), rng.normal(0, 0.1, 3)
        controller.input["wrench"][:3], controller.input["twist"][:3] = force, v
        controller.update(DT)
        old = [*old[1:], v] if k else [v] * len(old)
        moved = old[0]
        desired = controller.output["twist"][:3]
        stored = 3.0 * max(moved @ moved, desired @ desired)
        level = min(level + DT * float(force @ moved), 0.1 + 1.02 * stored + 1e-3)
        assert controller.output["tank"][0] <= level + 1e-9
