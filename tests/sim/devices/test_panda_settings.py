"""Which settings and motions a simulated Franka robot refuses."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.panda import Cabinet

from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import (
    Move,
    SetCartesianImpedance,
    SetCollisionBehavior,
    SetEEToK,
    SetFilters,
    SetJointImpedance,
    SetLoad,
    SetNEToEE,
)

IDENTITY = (1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0)
SHEARED = (1.0, 0.2, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0)
MIRRORED = (-1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0)


@pytest.mark.parametrize(
    ("command", "taken"),
    [
        (SetJointImpedance((14250.0,) * 7), True),
        (SetJointImpedance((-1.0,) * 7), False),
        (SetJointImpedance((20000.0,) * 7), False),
        (SetJointImpedance((float("nan"),) * 7), False),
        (SetCartesianImpedance((3000.0,) * 3 + (300.0,) * 3), True),
        (SetCartesianImpedance((3000.0,) * 6), False),
        (SetCollisionBehavior(*[(2.0,) * 7] * 4, *[(2.0,) * 6] * 4), True),
        (SetCollisionBehavior((3.0,) * 7, *[(2.0,) * 7] * 3, *[(2.0,) * 6] * 4), False),
        (SetCollisionBehavior(*[(0.0,) * 7] * 4, *[(2.0,) * 6] * 4), False),
        (SetCollisionBehavior(*[(float("inf"),) * 7] * 4, *[(2.0,) * 6] * 4), False),
        (SetEEToK(IDENTITY), True),
        (SetEEToK(SHEARED), False),
        (SetNEToEE(IDENTITY), True),
        (SetNEToEE(MIRRORED), False),
        (SetNEToEE((float("nan"),) * 16), False),
        (SetLoad(0.5, (0.1, 0.2, 0.3), (1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0)), True),
        (SetLoad(-0.5, (0.0,) * 3, (0.0,) * 9), False),
        (SetLoad(0.5, (0.0,) * 3, (1.0, 0.5, 0, 0, 1.0, 0, 0, 0, 1.0)), False),
        (SetLoad(0.5, (0.0,) * 3, (-1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0)), False),
        (SetFilters((1000.0,) * 5), True),
        (SetFilters((0.0,) * 5), False),
    ],
)
def test_settings_that_no_robot_takes_are_invalid_arguments(command: Any, taken: bool) -> None:
    expected = Status.SUCCESS if taken else Status.INVALID_ARGUMENT
    assert Cabinet().control.apply(command) is expected


@pytest.mark.parametrize(
    ("robot", "move", "status"),
    [
        ("panda", Move(0, 2), Status.NOT_POSSIBLE),  # Cartesian generators aren't simulated
        ("panda", Move(1, 0), Status.NOT_POSSIBLE),
        ("panda", Move(2, 4), Status.INVALID_ARGUMENT),  # no such generator in protocol 5
        ("panda", Move(7, 0), Status.INVALID_ARGUMENT),
        ("panda", Move(2, 1, path_deviation=(float("nan"),) * 3), Status.INVALID_ARGUMENT),
        ("fr3", Move(0, 4), Status.INVALID_ARGUMENT),  # torque alone, but no torque controller
        ("fr3", Move(2, 4), Status.MOTION_STARTED),
    ],
)
def test_motions_that_can_not_be_are_refused(robot: str, move: Move, status: Status) -> None:
    assert Cabinet(robot).control.move(move) is status
