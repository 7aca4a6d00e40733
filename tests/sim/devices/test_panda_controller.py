"""The simulated Franka cabinet: what it holds, follows, refuses and stops for."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest
from helpers.panda import Cabinet

from srl.drivers.panda.packets import RobotMode
from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import Move, SetCollisionBehavior, SetJointImpedance, SetLoad
from srl.runtime.models.robots import FR3, PANDA
from srl.sim.devices.panda.motion import LOST_IN_A_ROW, Setpoint, limits_of

TORQUE, VELOCITY, POSITION = Move(2, 1), Move(0, 1), Move(0, 0)
FREE = SetCollisionBehavior(*[(1e3,) * 7] * 4, *[(1e3,) * 6] * 4)
LAST = Setpoint(finished=True)


def torque(*values: float) -> Setpoint:
    """The last joints' torques, N m."""
    return Setpoint(tau=np.concatenate((np.zeros(7 - len(values)), values)))


def velocity(value: float, joint: int = 0) -> Setpoint:
    """One joint's velocity, rad/s."""
    dq = np.zeros(7)
    dq[joint] = value
    return Setpoint(dq=dq)


def moving(move: Move, robot: str = "panda", **options: Any) -> Cabinet:
    """A robot with a motion begun and a first packet taken."""
    cabinet = Cabinet(robot, **options)
    cabinet.run(5)
    assert cabinet.control.move(move) is Status.MOTION_STARTED
    q = cabinet.control.motion.q.copy()
    cabinet.run(1, Setpoint(q=q))
    assert cabinet.control.mode is RobotMode.MOVE, cabinet.control.names
    return cabinet


def push(cabinet: Cabinet, force: list[float]) -> None:
    """A force (N, world axes) on the flange, from now on."""
    world = cabinet.world
    world.data.xfrc_applied[world.model.body("arm/flange").id, :3] = force


def test_an_idle_robot_holds_its_arm_against_gravity() -> None:
    cabinet = Cabinet()
    cabinet.run(1000)
    assert cabinet.control.mode is RobotMode.IDLE
    np.testing.assert_allclose(cabinet.position, PANDA.home, atol=1e-6)


def test_a_motion_ends_with_its_last_packet() -> None:
    cabinet = moving(TORQUE)
    cabinet.run(20, torque(0.0))
    assert cabinet.control.take_outcome() is None
    cabinet.run(1, LAST)
    assert cabinet.control.mode is RobotMode.IDLE
    assert cabinet.control.take_outcome() is Status.SUCCESS
    assert cabinet.control.take_outcome() is None


def test_torques_move_the_joint_they_are_given_to() -> None:
    cabinet = moving(TORQUE)
    before = cabinet.position
    cabinet.run(200, torque(0.5, 0.0, 0.0, 0.0))
    assert (cabinet.position - before)[3] > 0.005
    cabinet.run(1, LAST)
    cabinet.run(300)
    after = cabinet.position
    cabinet.run(100)
    np.testing.assert_allclose(cabinet.position, after, atol=1e-5)  # caught, and held


@pytest.mark.parametrize("step", [1.5, -1.5, float("nan")])
def test_torques_may_change_by_one_newton_metre_a_packet(step: float) -> None:
    cabinet = moving(TORQUE)
    cabinet.run(1, torque(1.0))
    cabinet.run(1, torque(0.0))
    assert cabinet.control.mode is RobotMode.MOVE
    cabinet.run(1, torque(step))
    assert cabinet.control.names == ("controller_torque_discontinuity",)
    assert cabinet.control.mode is RobotMode.REFLEX
    assert cabinet.control.take_outcome() is Status.REFLEX_ABORTED


def test_a_lost_torque_is_held() -> None:
    cabinet = moving(TORQUE)
    cabinet.run(1, torque(0.7))
    cabinet.run(LOST_IN_A_ROW - 1)
    assert cabinet.control.mode is RobotMode.MOVE
    np.testing.assert_allclose(cabinet.control.tau_d, [0, 0, 0, 0, 0, 0, 0.7])


def test_twenty_lost_packets_in_a_row_end_a_motion() -> None:
    cabinet = moving(TORQUE)
    cabinet.run(LOST_IN_A_ROW - 1)
    cabinet.run(1, torque(0.0))
    cabinet.run(LOST_IN_A_ROW - 1)
    assert cabinet.control.mode is RobotMode.MOVE
    cabinet.run(1)
    assert cabinet.control.names == ("communication_constraints_violation",)
    assert cabinet.control.reception.total == 2 * LOST_IN_A_ROW - 1


def test_the_success_rate_is_that_of_the_last_hundred() -> None:
    cabinet = moving(TORQUE)
    assert cabinet.control.reception.rate == 1.0
    cabinet.run(200, lambda i: torque(0.0) if i % 4 else None)
    assert cabinet.control.reception.rate == pytest.approx(0.75)
    cabinet.run(100, torque(0.0))
    assert cabinet.control.reception.rate == 1.0


def test_a_client_may_take_its_time_before_its_first_packet() -> None:
    cabinet = Cabinet()
    cabinet.run(5)
    cabinet.control.move(TORQUE)
    cabinet.run(400)
    assert cabinet.control.mode is RobotMode.MOVE
    cabinet.run(200)
    assert cabinet.control.names == ("communication_constraints_violation",)


def test_velocities_are_followed_by_the_robots_own_controller() -> None:
    cabinet = moving(VELOCITY)
    before = cabinet.position
    cabinet.run(1000, lambda i: Setpoint(dq=np.full(7, 0.3 * sin(pi * i / 1000) ** 2)))
    cabinet.run(1, LAST)
    assert cabinet.control.take_outcome() is Status.SUCCESS
    np.testing.assert_allclose(cabinet.position - before, 0.15, atol=2e-3)


def test_positions_are_followed_by_the_robots_own_controller() -> None:
    cabinet = moving(POSITION)
    start = cabinet.control.motion.q.copy()
    cabinet.run(1001, lambda i: Setpoint(q=start + 0.05 * (1 - cos(pi * i / 1000))))
    np.testing.assert_allclose(cabinet.position, start + 0.1, atol=2e-3)
    assert cabinet.control.mode is RobotMode.MOVE


def test_a_lost_setpoint_is_extrapolated_at_constant_acceleration() -> None:
    ramp = 5.0  # rad/s^2
    lossy, whole = moving(VELOCITY), moving(VELOCITY)
    lossy.run(200, lambda i: None if i in (100, 101) else velocity(ramp * 1e-3 * i))
    whole.run(200, lambda i: velocity(ramp * 1e-3 * i))
    assert lossy.control.mode is RobotMode.MOVE
    np.testing.assert_allclose(lossy.control.motion.q, whole.control.motion.q, atol=1e-9)


def test_a_first_position_must_be_the_present_one() -> None:
    cabinet = Cabinet()
    cabinet.run(5)
    cabinet.control.move(POSITION)
    cabinet.run(1, Setpoint(q=cabinet.position + 0.01))
    assert cabinet.control.names == ("joint_position_motion_generator_start_pose_invalid",)


@pytest.mark.parametrize(
    ("name", "setpoints"),
    [
        ("joint_motion_generator_velocity_discontinuity", [velocity(0.1)]),
        ("joint_motion_generator_position_limits_violation", [velocity(float("nan"))]),  # the first that fails
        ("joint_motion_generator_acceleration_discontinuity", [velocity(0.0), velocity(0.014)]),
        (
            "joint_motion_generator_velocity_limits_violation",
            [velocity(0.007 * i if i else 0.0) for i in range(400)],
        ),
    ],
)
def test_setpoints_beyond_a_limit_are_a_reflex(name: str, setpoints: list[Setpoint]) -> None:
    cabinet = moving(VELOCITY)
    for setpoint in setpoints:
        if cabinet.control.mode is RobotMode.MOVE:
            cabinet.run(1, setpoint)
    assert cabinet.control.names == (name,)
    assert cabinet.control.reflex_reason.sum() == 1


def test_a_motion_out_of_a_joints_range_is_a_reflex() -> None:
    cabinet = moving(VELOCITY, parts={"arm": {"home": [2.85, *PANDA.home[1:].tolist()]}})
    cabinet.run(1000, lambda i: velocity(min(0.002 * i, 0.2)))
    assert cabinet.control.names == ("joint_motion_generator_position_limits_violation",)


def test_an_fr3_is_slower_near_the_ends_of_its_joints() -> None:
    home = [2.7, *FR3.home[1:].tolist()]
    speeds = {}
    for robot in ("panda", "fr3"):
        cabinet = moving(VELOCITY, robot, parts={"arm": {"home": home}})
        for i in range(600):
            if cabinet.control.mode is RobotMode.MOVE:
                cabinet.run(1, velocity(min(0.004 * i, 0.75)))
        speeds[robot] = cabinet.control.names
    assert speeds["panda"] == ("joint_motion_generator_position_limits_violation",)
    assert speeds["fr3"] == ("joint_motion_generator_velocity_limits_violation",)


def test_the_fr3s_velocity_limit_is_the_makers_formula() -> None:
    limits = limits_of("fr3")
    q = FR3.q_upper - 0.1
    expected = np.array([0.435, 0.467, 0.637, 0.541, 1.268, 0.561, 1.381])  # sqrt(2 dec 0.1) - offset
    slowest, fastest = limits.velocities(q)
    np.testing.assert_allclose(fastest, expected, atol=1e-3)
    assert (slowest < -2.6).all()
    np.testing.assert_allclose(limits.velocities(FR3.q_lower + 0.1)[0], -expected, atol=1e-3)


def test_too_fast_an_arm_is_stopped_whatever_moves_it() -> None:
    cabinet = moving(TORQUE)
    for i in range(1000):
        if cabinet.control.mode is RobotMode.MOVE:
            cabinet.run(1, torque(min(1.5, i * 0.1)))
    assert cabinet.control.names == ("joint_velocity_violation",)
    fastest = abs(cabinet.robot.part.velocity).max()
    cabinet.run(500)
    assert abs(cabinet.robot.part.velocity).max() < 0.01 < fastest


def test_external_forces_are_estimated_in_joints_and_at_the_frame_k() -> None:
    cabinet = moving(TORQUE)
    force = [8.0, -5.0, 3.0]
    push(cabinet, force)
    cabinet.run(40, torque(0.0))
    np.testing.assert_allclose(cabinet.control.wrench[:3], force, atol=0.3)
    np.testing.assert_allclose(cabinet.control.wrench[3:], 0.0, atol=0.3)


def test_a_collision_is_a_reflex_and_a_light_touch_a_contact() -> None:
    cabinet = Cabinet()
    low, high = (1.0,) * 7, (1e3,) * 7
    cabinet.control.apply(SetCollisionBehavior(low, high, low, high, (1.0,) * 6, (20.0,) * 6, (1.0,) * 6, (20.0,) * 6))
    cabinet.run(5)
    cabinet.control.move(TORQUE)
    cabinet.run(5, torque(0.0))
    push(cabinet, [0.0, 10.0, 0.0])
    cabinet.run(40, torque(0.0))
    assert cabinet.control.mode is RobotMode.MOVE
    assert cabinet.control.cartesian_contact[1] == 1
    assert cabinet.control.contact[0] == 1
    push(cabinet, [0.0, 30.0, 0.0])
    cabinet.run(20, torque(0.0))
    assert cabinet.control.names == ("cartesian_reflex",)


def test_an_idle_joint_gives_way_as_stiffly_as_it_was_told() -> None:
    sags = []
    for stiffness in (3000.0, 300.0):
        cabinet = Cabinet()
        assert cabinet.control.apply(FREE) is Status.SUCCESS
        assert cabinet.control.apply(SetJointImpedance((stiffness,) * 7)) is Status.SUCCESS
        cabinet.run(10)
        push(cabinet, [0.0, 20.0, 0.0])
        cabinet.run(2000)
        torque_on_1 = cabinet.robot.part.external_effort[0]
        sags.append((cabinet.position - PANDA.home)[0] * stiffness / torque_on_1)
    np.testing.assert_allclose(sags, 1.0, rtol=0.02)


def test_a_load_that_it_was_told_of_no_longer_pulls_its_arm_down() -> None:
    tool = {"part": "box", "at": "arm/flange", "size": [0.05, 0.05, 0.05], "mass": 1.0}
    reported, untold = (Cabinet(parts={"tool": tool}) for _ in range(2))
    assert reported.control.apply(SetLoad(1.0, (0.0, 0.0, 0.0), (0.0,) * 9)) is Status.SUCCESS
    for cabinet in (reported, untold):
        cabinet.run(1500)
    assert abs(reported.control.external).max() < 0.05
    assert abs(untold.control.external).max() > 1.0


def test_a_reflex_keeps_its_reason_after_recovery_until_the_next_motion() -> None:
    cabinet = moving(TORQUE)
    cabinet.run(1, torque(5.0))
    cabinet.run(20)
    assert cabinet.control.move(TORQUE) is Status.NOT_POSSIBLE
    assert cabinet.control.apply(FREE) is Status.NOT_POSSIBLE
    assert cabinet.control.recover() is None
    assert cabinet.control.mode is RobotMode.AUTOMATIC_ERROR_RECOVERY
    cabinet.run(30)
    assert cabinet.control.mode is RobotMode.IDLE
    assert (cabinet.control.names, cabinet.control.reflex_reason.sum()) == ((), 1)
    assert cabinet.control.move(TORQUE) is Status.MOTION_STARTED
    assert cabinet.control.reflex_reason.sum() == 0


def test_outside_its_range_only_a_person_can_recover_the_arm() -> None:
    cabinet = Cabinet()
    cabinet.world.data.qpos[0] = 2.93
    cabinet.run(1)
    assert cabinet.control.recover() is Status.MANUAL_RECOVERY


def test_the_user_stop_brakes_and_ends_a_motion() -> None:
    cabinet = moving(TORQUE, user_stop=[[0.1, 0.3]])
    cabinet.run(100, torque(0.3, 0.0, 0.0, 0.0))
    assert cabinet.control.mode is RobotMode.USER_STOPPED
    assert cabinet.control.take_outcome() is Status.EMERGENCY_ABORTED
    assert cabinet.control.move(TORQUE) is Status.NOT_POSSIBLE
    assert cabinet.control.recover() is Status.NOT_POSSIBLE
    cabinet.run(100)
    stopped = cabinet.position
    cabinet.run(90)
    np.testing.assert_allclose(cabinet.position, stopped, atol=2e-3)
    cabinet.run(30)
    assert cabinet.control.mode is RobotMode.IDLE
    assert cabinet.control.move(TORQUE) is Status.MOTION_STARTED


def test_setters_wait_for_idle_mode() -> None:
    cabinet = moving(TORQUE)
    assert cabinet.control.apply(FREE) is Status.NOT_POSSIBLE
    assert cabinet.control.move(TORQUE) is Status.NOT_POSSIBLE
    assert cabinet.control.stop_move() is Status.SUCCESS
    assert cabinet.control.take_outcome() is Status.PREEMPTED
    assert cabinet.control.apply(FREE) is Status.SUCCESS


def test_a_client_that_goes_away_leaves_a_reflex() -> None:
    cabinet = moving(TORQUE)
    cabinet.control.disconnect()
    assert cabinet.control.names == ("communication_constraints_violation",)
    cabinet.control.recover()
    cabinet.run(30)
    assert cabinet.control.mode is RobotMode.IDLE


def test_delay_and_loss_of_commands_are_options() -> None:
    late = moving(TORQUE, delay=5)
    late.run(1, torque(0.5))
    late.run(4, torque(0.0))
    assert late.control.tau_d[6] == 0.0
    late.run(1, torque(0.0))
    assert late.control.tau_d[6] == 0.5
    lossy = moving(TORQUE, dropout=0.2)
    lossy.run(1000, torque(0.0))
    assert 130 < lossy.control.reception.total < 270
    deaf = moving(TORQUE, deaf=[[0.05, 0.06], [0.1, 0.2]])
    deaf.run(80, torque(0.0))
    assert (deaf.control.mode, deaf.control.reception.total) == (RobotMode.MOVE, 10)
    deaf.run(80, torque(0.0))
    assert deaf.control.names == ("communication_constraints_violation",)


def test_noise_is_that_of_the_seed() -> None:
    noisy = {"position_noise": 1e-4, "velocity_noise": 1e-2, "effort_noise": 0.1}

    def states(seed: int) -> tuple[np.ndarray[Any, Any], bytes]:
        cabinet = Cabinet(parts={"seed": seed}, **noisy)
        rows, last = [], b""
        for _ in range(300):
            cabinet.run(1)
            record = cabinet.robot.write()
            true = cabinet.robot.part
            rows.append(np.concatenate((record["q"] - true.position, record["dq"] - true.velocity)))
            last = record.tobytes()
        return np.array(rows), last

    rows, last = states(1)
    assert states(1)[1] == last
    assert states(2)[1] != last
    spread = rows.std(axis=0)
    np.testing.assert_allclose(spread[:7], 1e-4, rtol=0.2)
    np.testing.assert_allclose(spread[7:], 1e-2, rtol=0.2)
