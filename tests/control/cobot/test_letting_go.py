"""Letting go: A or M switched off brakes the desired motion in the stated time, adds no energy, jumps nowhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.admittance import admittance, follow
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.cobot.admittance import Admittance
from srl.runtime.contracts import rotation

DT = 1e-3


def guided(**options: Any) -> Admittance:
    """Led along x at 0.49 m/s and about it at 0.48 rad/s."""
    controller = admittance(**options)
    controller.input["wrench"][:] = [20.0, 0, 0, 0.9, 0, 0]
    for _ in range(5000):
        follow(controller)
    assert controller.output["twist"][0] == pytest.approx(0.4925, abs=1e-3)
    assert controller.output["twist"][3] == pytest.approx(0.483, abs=1e-3)
    return controller


def coasted(controller: Admittance, seconds: float, dt: float = DT) -> tuple[float, float]:
    """How far it goes on, m and rad."""
    pose = controller.output["pose"].tolist()
    for _ in range(round(seconds / dt)):
        follow(controller, dt)
    x, y, z, *q = controller.output["pose"].tolist()
    turned = rotation.error((q[0], q[1], q[2], q[3]), (pose[3], pose[4], pose[5], pose[6]))
    return float(np.linalg.norm(np.subtract([x, y, z], pose[:3]))), float(np.linalg.norm(turned))


@pytest.mark.parametrize("modes", [[0, 1, 0, 0], [0, 0, 0, 0]])
def test_a_released_handle_stops_within_a_fifth_of_a_second(modes: list[float]) -> None:
    controller = guided()
    controller.input["modes"][:] = modes
    distance, angle = coasted(controller, 0.2)
    assert distance < 0.025
    assert angle < 0.04
    assert np.abs(controller.output["twist"]).max() < 0.01 * 0.48
    assert max(coasted(controller, 3.0)) < 1e-3


def lagging(controller: Admittance, seconds: float, gain: float = 3.0) -> tuple[float, float]:
    """How far a robot goes that makes up for `gain` of its error a second, m and rad."""
    started = controller.input["pose"].copy()
    for _ in range(round(seconds / DT)):
        controller.update(DT)
        x, y, z, qw, qx, qy, qz = controller.input["pose"].tolist()
        X, Y, Z, *q = controller.output["pose"].tolist()
        way = [gain * DT * far for far in (X - x, Y - y, Z - z)]
        turn = [gain * DT * far for far in rotation.error((q[0], q[1], q[2], q[3]), (qw, qx, qy, qz))]
        turned = rotation.product(rotation.exp(*turn), (qw, qx, qy, qz))
        controller.input["pose"][:] = [x + way[0], y + way[1], z + way[2], *turned]
        controller.input["twist"][:] = [v / DT for v in (*way, *turn)]
    end = controller.input["pose"]
    return float(np.linalg.norm(end[:3] - started[:3])), float(
        np.linalg.norm(rotation.error(tuple(end[3:].tolist()), tuple(started[3:].tolist())))
    )


@pytest.mark.slow
@pytest.mark.parametrize("modes", [[0, 0, 0, 0], [1, 0, 0, 0]])
def test_a_robot_that_lags_stops_where_it_is_as_the_desired_pose_comes_back_to_it(modes: list[float]) -> None:
    ways = {}
    for time in (None, 0.1):
        controller = admittance(release={"draw_in": time})
        controller.input["wrench"][:] = [20.0, 0, -8.0, 0, 0, 0.9]
        lagging(controller, 3.0)
        ahead = controller.output["pose"][:3] - controller.input["pose"][:3]
        assert np.linalg.norm(ahead) > 0.025
        if modes[0]:
            controller.input["wrench"][:3] = 0.0  # it is led on, but not turned
        controller.input["modes"][:] = modes
        ways[time] = lagging(controller, 2.0)
    if not modes[0]:
        assert ways[None][0] > 0.03
        assert ways[0.1][0] < 0.4 * ways[None][0]
    assert ways[None][1] > 0.1
    assert ways[0.1][1] < 0.4 * ways[None][1]


def test_what_leans_on_a_wall_leans_no_more_once_it_is_let_go() -> None:
    """The robot stands at a wall, 30 N push it against it; its desired pose is in the wall. Then A is off."""
    controller = admittance()
    controller.input["wrench"][:3] = [24.0, 0.0, -18.0]
    for _ in range(3000):
        controller.update(DT)
    assert np.linalg.norm(controller.output["pose"][:3]) > 0.03
    controller.input["modes"][:] = 0.0
    for _ in range(1000):
        controller.update(DT)
    assert np.linalg.norm(controller.output["pose"][:3]) < 0.001


def test_a_load_that_sagged_is_let_down_no_further() -> None:
    """It hangs 50 mm below the desired pose, and turned by 0.1 rad about a level axis, whatever that does."""
    controller = admittance()
    controller.input["wrench"][2] = 20.0
    for _ in range(500):
        follow(controller)
    controller.input["modes"][:] = 0.0
    for _ in range(300):
        follow(controller)
    height = controller.output["pose"][2]
    for _ in range(3000):
        controller.input["pose"][:] = controller.output["pose"]
        controller.input["pose"][2] -= 0.05
        controller.input["pose"][3:] = rotation.product(rotation.exp(0.1, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        controller.update(DT)
    assert controller.output["pose"][2] == pytest.approx(height, abs=1e-6)
    np.testing.assert_allclose(controller.output["pose"][3:], [1, 0, 0, 0], atol=1e-9)


def test_who_pushes_it_away_while_nobody_leads_stretches_its_spring() -> None:
    controller = admittance()
    controller.input["modes"][:] = 0.0
    controller.input["pose"][0] = -0.05
    for _ in range(1000):
        controller.update(DT)
    assert controller.output["pose"][0] == 0.0
    controller.input["modes"][:2] = 1.0
    controller.update(DT)
    controller.input["modes"][:2] = 0.0
    for _ in range(3000):
        controller.input["pose"][0] = controller.output["pose"][0] - 0.05  # whatever it does, it is 50 mm behind
        controller.update(DT)
    assert controller.output["pose"][0] == pytest.approx(-0.05, abs=1e-3)  # by what it was when it was let go


def test_rotation_alone_stops_if_it_is_switched_off_and_translation_goes_on() -> None:
    controller = guided()
    controller.input["modes"][:] = [1, 0, 0, 0]
    _, angle = coasted(controller, 0.2)
    assert angle < 0.04
    assert abs(controller.output["twist"][3]) < 0.01 * 0.48
    assert controller.output["twist"][0] == pytest.approx(0.4925, abs=1e-3)


def test_the_paper_s_law_coasts() -> None:
    controller = guided(release=None)
    controller.input["modes"][:] = 0.0
    distance, angle = coasted(controller, 8.0)
    assert distance == pytest.approx(0.0739, abs=5e-4)  # M/D of the speed
    assert angle == pytest.approx(0.268, abs=2e-3)


@settings(max_examples=30, deadline=None)
@given(
    st.tuples(*[st.floats(-2, 2)] * 6), st.sampled_from([5e-4, 1e-3, 2e-3, 1e-2]),
    st.lists(st.integers(0, 60), min_size=1, max_size=6),
)  # fmt: skip
def test_it_brakes_no_harder_than_stated_turns_nothing_round_and_sets_in_gradually(
    speed: Any, dt: float, presses: list[int]
) -> None:
    """Whatever the speed, the cycle, and whenever A is pressed: without a hand's force speeds only fall."""
    controller = admittance(dead_band=(0.0, 0.0), leash=None, tank=None)
    most = controller._config.release
    assert most is not None
    controller._virtual.velocity = list(speed)
    before, v = np.zeros(2), np.array(speed)
    for k in range(80):
        if k in presses:
            controller.input["modes"][0] = 1.0 - controller.input["modes"][0]
        follow(controller, dt)
        now = controller.output["twist"].copy()
        own = v * np.exp(-dt * np.array(controller._D) / controller._M)  # by the law's own damping
        braked = [np.linalg.norm((own - now)[part]) / dt for part in (slice(3), slice(3, 6))]
        assert (np.abs(now) <= np.abs(own) + 1e-12).all()
        assert (now * v >= 0).all()
        assert braked[0] <= most.deceleration * (1 + 1e-9)
        assert braked[1] <= most.angular * (1 + 1e-9)
        # The brake's deceleration sets in and goes over `onset`.
        steps = np.abs(np.array(braked) - before) * most.onset / dt
        assert (steps <= 1.5 * np.array([most.deceleration, most.angular]) * (1 + dt / most.settle)).all()
        before, v = np.array(braked), now
