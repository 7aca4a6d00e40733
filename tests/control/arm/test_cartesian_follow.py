"""An arm's tool that follows: its program against an independent solver, limits, obstacles, losses, the guard."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.arm_urdf import HIP
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.optimize import lsq_linear

from srl.control.arm.cartesian_follow import CartesianFollow, CartesianFollowConfig
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.rotation import exp, matrix, product
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots import PANDA
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.testing import ControllerConformance, bound

HIP_ARM = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
Q = np.array([0.2, 0.5, 0.7, 0.1])
DT = 0.01


def law(q: Any = Q, transforms: Any = None, **options: Any) -> CartesianFollow:
    given = {"robot": HIP_ARM, "target": "point"} | options
    made = bound(CartesianFollow("follow", CartesianFollowConfig.model_validate(given)), transforms)
    made.input["q"][:] = q
    for name in ("q",):
        if name in made.applied:
            made.applied[name][:] = q
    robot = made.config.robot
    place = robot.forward(np.asarray(q, float))
    made.input["target"][:3] = place[:3, 3]
    if len(made.input["target"]) == 7:
        x, y, z, w = pin.Quaternion(place[:3, :3]).coeffs().tolist()
        made.input["target"][3:] = w, x, y, z
    made.reset()
    return made


def run(made: CartesianFollow, cycles: int, lag: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Joints and velocities; the guard lets all through, and the measured joints are a share `lag` on the way."""
    q, v = [], []
    for _ in range(cycles):
        made.update(DT)
        made.applied["q"][:] = made.output["q"]
        made.input["q"][:] += lag * (made.output["q"] - made.input["q"])
        q.append(made.output["q"].copy())
        v.append(made.output["q_velocity"].copy())
    return np.array(q), np.array(v)


class TestPoint(ControllerConformance):
    inputs = {"q": Q, "target": [0.3, 0.1, 0.1]}  # noqa: RUF012
    start = {"q": Q, "q_velocity": np.zeros(4)}  # noqa: RUF012

    def law(self) -> CartesianFollow:
        return law()


class TestPoseByVelocity(ControllerConformance):
    inputs = {"q": PANDA.home, "target": [0.4, 0.1, 0.4, 0.0, 1.0, 0.0, 0.0]}  # noqa: RUF012
    start = {"velocity": np.zeros(7)}  # noqa: RUF012

    def law(self) -> CartesianFollow:
        return law(PANDA.home, robot="panda", target="pose", command="velocity")


def test_it_reaches_a_point_and_a_pose() -> None:
    made = law()
    goal = HIP_ARM.forward(np.array([-0.2, 0.8, 0.4, 0.1]))[:3, 3]
    made.input["target"][:] = goal
    q, v = run(made, 400)
    assert HIP_ARM.forward(q[-1])[:3, 3] == pytest.approx(goal, abs=1e-3)
    assert np.abs(v[-1]).max() < 0.05
    arm = law(PANDA.home, robot="panda", target="pose")
    place = PANDA.forward(np.array(PANDA.home) + 0.15)
    x, y, z, w = pin.Quaternion(place[:3, :3]).coeffs().tolist()
    arm.input["target"][:] = *place[:3, 3], w, x, y, z
    q, _ = run(arm, 500)
    assert PANDA.forward(q[-1]) == pytest.approx(place, abs=2e-3)


def test_a_target_in_a_frame_that_moves_is_followed_there() -> None:
    goal = HIP_ARM.forward(Q)[:3, 3] + np.array((0.02, -0.05, 0.03))
    turn = exp(0.3, -0.2, 0.7)
    placed = np.array((0.4, -0.1, 0.2, *turn))
    made = law(transforms={"target": placed})
    R = np.array(pin.Quaternion(turn[0], *turn[1:]).toRotationMatrix())
    made.input["target"][:] = R.T @ (goal - placed[:3])
    q, _ = run(made, 300)
    assert HIP_ARM.forward(q[-1])[:3, 3] == pytest.approx(goal, abs=1e-3)


def test_a_hand_held_point_is_followed_closely() -> None:
    made = law()
    middle, off = made.input["target"].copy(), []
    for i in range(800):
        t = i * DT
        made.input["target"][:] = middle + 0.06 * np.array((0, np.sin(2.0 * t), np.sin(3.0 * t)))
        run(made, 1)
        off.append(made.output["missing"][0])
    assert np.sqrt(np.mean(np.square(off[200:]))) < 0.017


@settings(max_examples=15, deadline=None)
@given(st.tuples(*[st.floats(-0.5, 0.5)] * 3), st.tuples(*[st.floats(-0.9, 0.9)] * 4))
def test_no_limit_is_ever_passed(by: Any, share: Any) -> None:
    q0 = np.array(share) * (HIP_ARM.q_upper - 0.05)
    made = law(q0, farthest=5.0, joint_speed=0.3)
    made.input["target"][:] += by
    q, v = run(made, 150)
    assert (q <= HIP_ARM.q_upper - 0.02 + 1e-3).all()
    assert (q >= HIP_ARM.q_lower + 0.02 - 1e-3).all()
    assert (np.abs(v) <= 0.3 * HIP_ARM.dq_max + 1e-9).all()
    assert (np.abs(np.diff(v, axis=0, prepend=0.0)) <= 10.0 * DT + 1e-9).all()


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-0.3, 0.3)] * 3), st.tuples(*[st.floats(-0.8, 0.8)] * 4))
def test_the_tool_is_missed_by_no_more_than_an_independent_solver_misses_it(by: Any, share: Any) -> None:
    q0 = np.array(share) * HIP_ARM.q_upper
    made = law(q0, farthest=5.0, posture=0.0, damping=0.001, ahead=0.0, speed=3.0)
    made.input["target"][:] += by
    made.update(DT)
    x = made.output["q_velocity"]
    model = pinocchio_model(HIP_ARM)
    data = model.createData()
    A = pin.computeFrameJacobian(model, data, q0, model.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED)[:3]
    wanted = 4.0 * np.array(by)
    wanted *= min(1.0, 3.0 / max(float(np.linalg.norm(wanted)), 1e-12))
    lower, upper = made._approach.speeds(q0, np.zeros(4), DT)
    best = lsq_linear(A, wanted, (lower, np.maximum(upper, lower + 1e-12)), tol=1e-12)
    assert float(np.linalg.norm(A @ x - wanted)) <= float(np.linalg.norm(best.fun)) + 2e-3


def test_obstacles_in_the_arms_frame_are_kept_off() -> None:
    q0 = np.array([0.0, 0.3, 0.9, 0.0])
    wall = {"wall": {"size": [0.02, 1.0, 1.0], "position": [0.43, 0.0, 0.0]}}
    tool = {"end": [0.0, 0.0, 0.0], "radius": 0.02}
    made = law(q0, limits={"distances": {"least": 0.03, "obstacles": wall, "tool": tool}})
    free = law(q0)
    for each in (made, free):
        each.input["target"][:] = 0.55, 0.0, 0.05
    run(free, 300)
    assert HIP_ARM.forward(free.output["q"])[0, 3] > 0.45  # without the wall it goes there
    run(made, 300)
    found = made.metrics()
    assert 0.027 < found["least_distance_m"] < 0.04
    assert found["solver_failures"] == 0


def test_a_target_that_is_lost_is_waited_for_at_rest_and_then_stops_the_limb() -> None:
    made = law(timeout=0.5)
    made.input["target"][:] += (0.1, 0.1, 0.0)
    run(made, 30)
    made.input["target"][:] = np.nan
    _, v = run(made, 49)
    assert np.abs(v[-1]).max() < 1e-9
    assert not made.lost
    run(made, 3)
    assert made.lost
    made.input["target"][:] = HIP_ARM.forward(made.output["q"])[:3, 3] + (0.05, 0.0, 0.0)
    _, v = run(made, 5)
    assert not made.lost
    assert np.abs(np.diff(v, axis=0)).max() < 10.0 * DT + 1e-9  # no jump after it


def test_millimetres_are_not_followed() -> None:
    made = law()
    made.input["target"][:] *= 1000.0
    q, _ = run(made, 120)
    assert q[-1] == pytest.approx(Q)
    assert made.lost


def test_what_the_guard_holds_back_is_not_wound_up() -> None:
    made = law()
    made.input["target"][:] += (0.1, 0.1, 0.05)
    for _ in range(100):
        made.update(DT)  # `applied` stays where it was: the guard lets nothing through
    assert np.abs(made.output["q"] - Q).max() < 0.01
    assert np.abs(made.output["q_velocity"]).max() <= 10.0 * DT + 1e-9


def test_a_joint_that_somebody_holds_is_not_commanded_on_and_on() -> None:
    made = law(max_following_error=0.1)
    made.input["target"][:] = HIP_ARM.forward(np.array([1.2, 0.5, 0.7, 0.1]))[:3, 3]
    q, _ = run(made, 400, lag=0.0)
    assert np.abs(q[-1] - Q).max() < 0.15


def test_live_parameters_are_followed_gradually() -> None:
    made = law()
    made.input["target"][:] += (0.2, 0.3, 0.0)
    run(made, 30)
    made.param["speed"][()] = 0.0
    _, v = run(made, 120)
    assert np.abs(np.diff(v, axis=0)).max() <= 10.0 * DT + 1e-9
    assert np.abs(v[-1]).max() < 1e-6


@pytest.mark.parametrize("name", ["q", "target"])
def test_a_number_that_is_none_leaves_nothing_behind(name: str) -> None:
    made = law()
    made.input["target"][:] += (0.05, 0.0, 0.0)
    run(made, 5)
    kept, last = made.input[name].copy(), made.output["q"].copy()
    made.input[name][:] = np.nan
    made.update(DT)
    made.input[name][:] = kept
    made.applied["q"][:] = last
    made.update(DT)
    assert np.isfinite(made.output["q"]).all()
    assert made.output["q"] == pytest.approx(last, abs=0.01)


@pytest.mark.parametrize("command", ["position", "velocity"])
def test_a_reset_without_measured_joints_begins_where_the_limb_is(command: str) -> None:
    made = law(command=command, timeout=0.2)
    made.input["q"][:] = np.nan
    for array in made.applied.values():
        array[:] = np.nan
    made.reset()
    name = "q" if command == "position" else "velocity"
    for _ in range(15):
        made.update(0.02)
        assert not np.isfinite(made.output[name]).any(), "the guard refuses it"
    assert made.lost
    made.input["q"][:] = Q
    if command == "velocity":
        made.applied["velocity"][:] = 0.0
    else:
        made.applied["q"][:] = Q
    made.update(0.02)
    assert not made.lost
    started = Q if command == "position" else np.zeros(4)
    assert made.output[name] == pytest.approx(started, abs=0.01)


def test_the_step_is_that_of_another_solver_of_the_quadratic_program() -> None:
    """All its terms, and joint speeds that bind: stacked least squares within intervals (scipy)."""
    joint_weight = {**dict.fromkeys(HIP_ARM.labels, 1.0), "yaw": 3.0}
    made = law(Q, posture=2.0, damping=0.05, ahead=0.0, speed=3.0, joint_weight=joint_weight)
    made._posture[:] = Q + np.array([0.2, -0.1, 0.15, 0.1])
    by = np.array([0.1, 0.2, -0.15])
    made.input["target"][:] += by
    model = pinocchio_model(HIP_ARM)
    A = pin.computeFrameJacobian(model, model.createData(), Q, model.getFrameId(FLANGE), pin.LOCAL_WORLD_ALIGNED)[:3]
    root = np.diag(0.05 * np.sqrt([joint_weight[name] for name in HIP_ARM.labels]))
    pull = root @ (2.0 * (made._posture - Q))
    free = np.linalg.lstsq(np.vstack([A, root]), np.concatenate([4.0 * by, pull]), rcond=None)[0]
    # Within limits: nearest to the free step, the task `priority` times before the motion, both scaled to one.
    weight = np.sqrt(made.config.limits.priority / np.max(np.sum((A / root.diagonal()) ** 2, axis=0)))
    stacked = np.vstack([weight * A, root])
    lower, upper = made._approach.speeds(Q, np.zeros(4), DT)
    best = lsq_linear(stacked, stacked @ free, (lower, upper), tol=1e-13)
    assert (best.active_mask != 0).any()
    made.update(DT)
    assert made.output["q_velocity"] == pytest.approx(best.x, abs=1e-5)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"joint_weight": {"yaw": 1.0}}, "joint_weight: "),
        ({"robot": "pando"}, "no arm 'pando'"),
        ({"target": "line"}, "target"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        law(**options)


@pytest.mark.parametrize("lost", [False, True], ids=["jumps", "comes back turned"])
def test_a_target_that_turns_at_once_is_approached_the_short_way_round(lost: bool) -> None:
    made = law(PANDA.home, robot="panda", target="pose")
    start = tuple(made.input["target"][3:])
    made.input["target"][3:] = product(exp(0.0, 0.0, 2.9), start)
    run(made, 3)
    if lost:
        held = made.input["target"].copy()
        made.input["target"][:] = np.nan
        run(made, 50)
        made.input["target"][:] = held
    made.input["target"][3:] = product(exp(0.0, 0.0, -0.6), start)
    q, _ = run(made, 300)
    there = PANDA.forward(q[0])[:3, 0]
    aim = np.array(matrix(exp(0.0, 0.0, -0.6))) @ PANDA.forward(PANDA.home)[:3, 0]
    cosines = [float(PANDA.forward(each)[:3, 0] @ aim) for each in q[::20]]
    assert min(cosines) > float(there @ aim) - 0.15  # the long way round goes through -1
    assert cosines[-1] > 0.99
