"""A driver that reports now nothing, now the most that ever was, makes no command grow faster than it may."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.signals import Command, Kind, Stop
from srl.runtime.guard import GUARDS, GuardLimits

LIMITS: dict[Kind, dict[str, Any]] = {
    Kind.VELOCITY: {"velocity": 1.0, "acceleration": 5.0},
    Kind.TORQUE: {"velocity": 2.0, "effort": 20.0, "effort_rate": 200.0, "inertia": 1.0},
}
RATE = {Kind.VELOCITY: 5.0, Kind.TORQUE: 200.0}  # of the command at most, a second
MOST = {Kind.VELOCITY: 1.0, Kind.TORQUE: 20.0}


@pytest.mark.parametrize("kind", list(LIMITS))
@pytest.mark.parametrize("rate", [100, 500])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("period", [0.02, 0.1])
@pytest.mark.parametrize("resolution", [0.0, 0.05])
@pytest.mark.parametrize("each", [1, 2, 5])
@pytest.mark.parametrize("then", ["goes on", "stops"])
def test_a_report_that_alternates_makes_no_step_away_from_zero(
    kind: Kind, rate: int, side: int, period: float, resolution: float, each: int, then: str
) -> None:
    dt = 1 / rate
    command = Command(name="c", shape=(1,), unit="1", kind=kind, period=period, resolution=resolution)
    guard = GUARDS[kind]("guard.c", command, GuardLimits(**LIMITS[kind]).to_limits((1,), "guard.c"), dt)
    applied, sent, q, qd = np.zeros(1), np.full(1, np.nan), np.zeros(1), np.zeros(1)
    guard.bind(applied, q, qd, sent)
    guard.reset(np.zeros(1))
    highest, left, reached = 0.0, False, 0.0
    for k in range(2 * rate):
        before = float(applied[0])
        guard.resynchronise(left, dt)
        between = float(applied[0])
        if then == "stops" and k > rate:
            guard.stop(Stop.HOLD, dt)
        else:
            guard.step(np.full(1, 10.0 * side * MOST[kind]), None, dt)
        after = float(applied[0])
        for here in (between, after):
            grown = abs(here) - abs(before) if here * before >= 0.0 else abs(here)
            assert grown <= RATE[kind] * dt * (1 + 1e-9) + 1e-9, f"{before} to {here} in cycle {k}"
        highest = max(highest, abs(after))
        reached = max(reached, abs(after))
        honest = k < rate // 4  # at first all is well
        sent[:], left = (after if honest else side * highest if k // each % 2 else 0.0), True
    assert reached >= 0.9 * RATE[kind] * min(dt * (rate // 4 - 5), MOST[kind] / RATE[kind])
