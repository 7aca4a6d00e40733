"""pylibfranka (libfranka 0.21, FCI protocol 10), unchanged, moves the simulated FR3."""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers import panda as helpers_panda

from srl.runtime.models.robots import FR3, Payload
from srl.runtime.models.robots.pinocchio_model import pinocchio_model

pytestmark = pytest.mark.skipif(importlib.util.find_spec("pylibfranka") is None, reason="pylibfranka isn't installed")

HOST = helpers_panda.host()
BEGIN = f"""
import json, math
import pylibfranka as franka
robot = franka.Robot("{HOST}", franka.RealtimeConfig.kIgnore)
said = {{"start": list(robot.read_once().q)}}
IMPEDANCE = franka.ControllerMode.JointImpedance
"""


def run(program: str, **options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    twin = helpers_panda.twin("fr3", HOST, 1337, **options)
    output = helpers_panda.serve(twin, BEGIN + program + "\nprint(json.dumps(said))")
    return output, twin.metrics()


@pytest.mark.slow
def test_it_runs_torque_velocity_and_position_loops() -> None:
    output, metrics = run("""
control = robot.start_torque_control()
for n in range(1500):
    state, period = control.readOnce()
    wanted = [max(-1.0, min(1.0, -2 * v)) for v in state.dq]
    wanted[3] += 0.5 * math.sin(n * 0.01)
    command = franka.Torques(wanted)
    command.motion_finished = n == 1499
    control.writeOnce(command)
said["after_torque"] = list(robot.read_once().q)
control = robot.start_joint_velocity_control(IMPEDANCE)
for n in range(1000):
    state, period = control.readOnce()
    command = franka.JointVelocities([0.2 * math.sin(math.pi * n / 1000) ** 2] * 7)
    command.motion_finished = n == 999
    control.writeOnce(command)
said["after_velocity"] = list(robot.read_once().q)
control = robot.start_joint_position_control(IMPEDANCE)
for n in range(1000):
    state, period = control.readOnce()
    first = list(state.q_d) if n == 0 else first
    command = franka.JointPositions([q + 0.025 * (1 - math.cos(math.pi * n / 999)) for q in first])
    command.motion_finished = n == 999
    control.writeOnce(command)
said["after_position"] = list(robot.read_once().q)
""")
    np.testing.assert_allclose(output["start"], FR3.home, atol=1e-4)
    assert 0.005 < output["after_torque"][3] - output["start"][3] < 0.1
    np.testing.assert_allclose(np.subtract(output["after_velocity"], output["after_torque"]), 0.1, atol=0.005)
    np.testing.assert_allclose(np.subtract(output["after_position"], output["after_velocity"]), 0.05, atol=0.005)
    assert metrics["requests"]["Move"] == 3
    assert (metrics["reflexes"], metrics["packets_lost"]) == (0, 0)


def test_a_jump_of_torque_is_a_reflex_that_recovery_clears() -> None:
    output, metrics = run("""
def loop(last, jump):
    control = robot.start_torque_control()
    for n in range(last + 1):
        state, period = control.readOnce()
        command = franka.Torques([0.0] * 6 + [jump if n > last // 2 else 0.0])
        command.motion_finished = n == last
        control.writeOnce(command)
try:
    loop(200, 8.0)
except franka.ControlException as error:
    said["error"] = str(error)
said["mode"] = robot.read_once().robot_mode.name
robot.automatic_error_recovery()
loop(100, 0.0)
said["well"] = robot.read_once().robot_mode.name
""")
    assert "controller_torque_discontinuity" in output["error"]
    assert output["mode"] == "Reflex"
    assert output["well"] == "Idle"
    assert metrics["reflexes"] == 1


def test_it_reads_the_model_and_its_wrong_values_are_refused() -> None:
    output, _ = run("""
state = robot.read_once()
model = robot.load_model()
said["mass"] = list(model.mass(state))[::8]
said["gravity"] = list(model.gravity(state))
robot.set_collision_behavior([20.0] * 7, [20.0] * 7, [20.0] * 6, [20.0] * 6)
robot.set_joint_impedance([1000.0] * 7)
robot.set_load(1.0, [0.0, 0.0, 0.1], [0.0] * 9)
loaded = robot.read_once()
while not loaded.m_load:
    loaded = robot.read_once()
said["loaded"] = list(model.gravity(loaded))
try:
    robot.set_load(-1.0, [0.0] * 3, [0.0] * 9)
except franka.CommandException as error:
    said["error"] = str(error)
""")
    np.testing.assert_allclose(output["mass"], [0.4612, 1.4450, 0.8789, 0.7887, 0.0279, 0.0326, 0.0049], atol=1e-3)
    np.testing.assert_allclose(output["gravity"], [0, -1.7714, -0.6440, 18.5736, 0.6338, 1.6937, 0], atol=0.02)
    with_load = pinocchio_model(FR3, payload=Payload(1.0, (0.0, 0.0, 0.1)))
    expected = pin.computeGeneralizedGravity(with_load, with_load.createData(), np.array(output["start"]))
    np.testing.assert_allclose(output["loaded"], expected, atol=0.02)
    assert "invalid argument" in output["error"]
