"""How far a limb is taken to be from its command: what is measured, beyond what its lag explains."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.verified import DT, LAG, Scene

from srl.runtime.contracts.clearance import Braking
from srl.runtime.contracts.signals import Stop


def test_the_slack_is_what_is_measured_where_that_is_more():
    scene = Scene(start=(-1.0, 0.0), tracking=0.01)
    assert scene.guard.verified is not None
    for _ in range(5):
        scene.step((-1.0, 0.0))
    for beside, slack in ((0.0, 0.01), (0.005, 0.01), (0.1, 0.1)):
        scene.at[1] = beside
        scene.look()
        scene.guard.step(np.array([-1.0, 0.0]), None, DT)
        assert scene.guard.verified._slack == pytest.approx([0.01, slack])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_is_compared_with_its_own_commands(side, joint):
    """The other one is where this one has been pushed to."""
    scene, start = Scene(start=(-0.5 * side, 0.5 * side)), np.array([-0.5 * side, 0.5 * side])
    assert scene.guard.verified is not None
    for _ in range(5):
        scene.step(start)
    scene.at[joint] += side * (0.3 if joint == 0 else -0.3)
    scene.look()
    scene.guard.step(start, None, DT)
    assert scene.guard.verified._slack == pytest.approx([0.3, 0.0] if joint == 0 else [0.0, 0.3])


def test_the_slack_is_measured_while_the_guard_halts_too():
    """A hand takes the limb during a stop, or while the command is none: the first cycle after it must know."""
    for halt in ("stop", "nan"):
        scene = Scene(start=(-1.0, 0.0))
        assert scene.guard.verified is not None
        for _ in range(60):
            scene.step((1.0, 0.0))
        for _ in range(60):
            scene.stop() if halt == "stop" else scene.step((np.nan, 0.0))
        rest = scene.applied.copy()
        scene.at[0] -= 0.15
        scene.look()
        scene.guard.stop(Stop.HOLD, DT)
        assert scene.guard.verified._slack[0] == pytest.approx(0.15)
        scene.look()
        scene.guard.step(rest, None, DT)
        assert scene.guard.verified._slack[0] == pytest.approx(0.15)


def test_a_limb_late_by_the_lag_needs_no_more_slack_and_one_that_is_later_does():
    slack = {}
    for late in (0, 3, 6, 12):
        scene = Scene(start=(-1.0, 0.0), late=late)
        assert scene.guard.verified is not None
        most = 0.0
        for _ in range(60):
            scene.step((1.0, 0.5))
            most = max(most, float(scene.guard.verified._slack.max()))
        slack[late] = most
    assert slack[0] == slack[3] == 0.0
    assert slack[12] > slack[6] > 0.02


@pytest.mark.parametrize("least_lag", [0.0, 0.01, LAG])
def test_joints_of_different_lags_leave_the_path_by_no_more_than_is_counted(least_lag):
    """Each joint is where its command was some time ago, between the shortest and the longest lag."""
    scene, seen, rng = Scene(start=(-1.0, 0.0)), list[Braking](), np.random.default_rng(0)
    judge = scene.clearance.clear

    def keep(motion: Braking) -> bool:
        seen.append(motion)
        return judge(motion)

    scene.clearance.clear = keep  # type: ignore[method-assign]
    scene.guard.keep_clear(scene.clearance, LAG, np.zeros(2), least_lag=least_lag)
    scene.guard.reset(scene.at)
    commands, slacks = [scene.at.copy()], [np.zeros(2)]
    for k in range(150):
        scene.step((1.0, 0.8) if k < 60 else (-1.0, -0.4))
        commands.append(scene.applied.copy())
        slacks.append(seen[-1].slack.copy())
    at, times = np.array(commands), DT * np.arange(len(commands))
    middle = (LAG + least_lag) / 2
    for t in np.arange(LAG, times[-1], 0.003):
        lags = rng.choice([least_lag, LAG], 2)
        limb = [np.interp(t - lags[i], times, at[:, i]) for i in range(2)]
        path = [np.interp(t - middle, times, at[:, i]) for i in range(2)]
        assert (np.abs(np.subtract(limb, path)) <= slacks[int((t - middle) / DT) + 1] + 1e-9).all()
    if least_lag == LAG:
        assert not np.array(slacks).any()
