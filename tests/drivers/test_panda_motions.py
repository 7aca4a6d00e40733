"""Motions of the Panda driver with a scripted robot: how they begin, what leaves for the robot, how they end."""

import numpy as np
import pytest
from helpers.fci import HOME
from helpers.fci_pair import INTERFACES, VERSIONS

from srl.drivers.panda.packets import Controller, Generator
from srl.drivers.panda.requests import Move, StopMove
from srl.runtime.contracts.signals import Kind, Stop

# -- motions


@VERSIONS
@INTERFACES
def test_a_motion_is_asked_for_and_each_state_answered(pair, version, interface):
    p = pair(version, interface=interface)
    assert not p.robot.moving
    p.command[:] = HOME if interface == "position" else 0
    p.start()
    move = next(body for body in p.robot.requests if isinstance(body, Move))
    wanted = {
        "torque": (Controller.EXTERNAL, Generator.JOINT_VELOCITY if version == 5 else Generator.NONE),
        "velocity": (Controller.JOINT_IMPEDANCE, Generator.JOINT_VELOCITY),
        "position": (Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION),
    }[interface]
    assert (move.controller, move.generator + 1) == wanted
    p.robot.commands.clear()
    first = int(p.robot.state["message_id"]) + 1
    p.cycle(50)
    assert [int(c["message_id"]) for c in p.robot.commands] == list(range(first, first + 50))
    for command in p.robot.commands:
        assert not command["motion_generation_finished"]
        assert (command["dq_c"] == 0).all()
        assert (command["tau_J_d"] == 0).all()
        if interface == "position":
            assert command["q_c"] == pytest.approx(HOME, abs=1e-6)


@VERSIONS
def test_a_torque_step_reaches_the_robot_as_a_ramp(pair, version):
    p = pair(version)
    p.start()
    p.command[:] = 5.0, -5.0, 2.0, 0.0, 1.0, 20.0, 0.5
    p.robot.commands.clear()
    p.cycle(30)
    torques = np.array([c["tau_J_d"] for c in p.robot.commands])
    assert (np.abs(np.diff(torques, axis=0)) < 1.0).all()
    assert torques[-1] == pytest.approx([5.0, -5.0, 2.0, 0.0, 1.0, 12.0, 0.5])
    assert torques[6] == pytest.approx([5.0, -5.0, 2.0, 0.0, 1.0, torques[6][5], 0.5])


@VERSIONS
def test_a_velocity_step_reaches_the_robot_without_a_jerk(pair, version):
    p = pair(version, interface="velocity")
    p.start()
    p.command[:] = 0.4
    p.robot.commands.clear()
    p.cycle(200)
    dq = np.array([c["dq_c"] for c in p.robot.commands])
    ddq = np.diff(dq, axis=0, prepend=0) / 1e-3
    jerk = np.diff(ddq, axis=0, prepend=0) / 1e-3
    limits = p.driver.limits["velocity_command"]
    assert (np.abs(ddq) <= 1.001 * limits.acceleration).all()
    assert (np.abs(jerk) <= 1.001 * limits.jerk).all()
    assert dq[-1] == pytest.approx([0.4] * 7)
    assert p.state["velocity"] == pytest.approx([0.4] * 7)


def test_a_position_is_moved_to_smoothly(pair):
    p = pair(10, interface="position")
    p.command[:] = HOME
    p.start()
    for k in range(300):
        p.command[:] = np.array(HOME) + 0.01 * (1 - np.cos(2 * np.pi * k / 300))
        p.cycle()
    p.cycle(200)
    assert p.state["position"] == pytest.approx(p.command, abs=1e-4)


@VERSIONS
@INTERFACES
def test_stop_ends_the_motion_in_good_order_and_another_can_follow(pair, version, interface):
    p = pair(version, interface=interface)
    p.command[:] = HOME if interface == "position" else 0
    p.start()
    if interface == "velocity":
        p.command[:] = 0.3
        p.cycle(100)
    p.driver.stop(Stop.HOLD)
    p.until(lambda: not p.robot.moving, write=False)
    p.cycle(3, write=False)
    last = p.robot.commands[-1]
    flag = "torque_command_finished" if version == 10 and interface == "torque" else "motion_generation_finished"
    assert last[flag]
    assert (last["dq_c"] == 0).all()
    assert np.abs(p.robot.state["dq_d"]).max() < 1e-3
    assert p.driver.health.fault == ""
    assert not any(isinstance(body, StopMove) for body in p.robot.requests)
    p.robot.commands.clear()
    p.command[:] = p.state["position"] if interface == "position" else 0
    p.start()
    assert p.driver.metrics()["moves"] == 2
    assert p.driver.health.fault == ""


def test_a_torque_motion_brakes_what_still_moves_before_it_ends(pair):
    p = pair(10)
    p.start()
    p.robot.state["dq"] = 0.5
    p.driver.stop(Stop.HOLD)
    p.cycle(60, write=False)
    assert p.robot.moving
    damping = p.robot.commands[-1]["tau_J_d"]
    limits = p.driver.limits["torque_command"]
    assert damping == pytest.approx(-0.5 * limits.effort / limits.velocity, rel=1e-6)
    p.robot.state["dq"] = 0.0
    p.cycle(3, write=False)
    assert not p.robot.moving


def test_a_motion_ends_when_the_writes_cease(pair):
    p = pair(10, interface="velocity")
    p.start()
    p.command[:] = 0.2
    p.cycle(50)
    p.until(lambda: not p.robot.moving, write=False)
    ids = [int(c["message_id"]) for c in p.robot.commands]
    assert max(np.diff(ids)) <= 4  # far from the 20 that the robot stops for
    assert p.driver.health.fault == ""


@VERSIONS
def test_close_ends_the_motion_first(pair, version):
    p = pair(version, interface="velocity")
    p.start()
    p.command[:] = 0.2
    p.cycle(50)
    p.close()
    assert p.robot.commands[-1]["motion_generation_finished"]
    assert not any(isinstance(body, StopMove) for body in p.robot.requests)
    p.driver.close()
    assert not p.driver.health.connected
    assert p.driver.fileno() is None


def test_close_stops_a_motion_that_does_not_end(pair):
    p = pair(10)
    p.start()
    p.robot.shy = True
    p.close()
    assert isinstance(p.robot.requests[-1], StopMove)


def test_no_stop_frame_is_needed(pair):
    p = pair(10)
    assert p.driver.stop_frames(Stop.HOLD) == ()
    (command,) = p.driver.commands
    assert (command.kind, command.feedback, command.stops[0]) == (Kind.TORQUE, "position", Stop.HOLD)
