"""panda-python (libfranka 0.9.2, FCI protocol 5), unchanged, moves the simulated Panda."""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
import pytest
from helpers import panda as helpers_panda

from srl.runtime.models.robots import PANDA

pytestmark = pytest.mark.skipif(importlib.util.find_spec("panda_py") is None, reason="panda-python isn't installed")

BARE = """
import json, math
from panda_py import libfranka
robot = libfranka.Robot("HOST", libfranka.RealtimeConfig.kIgnore)
said = {"version": robot.server_version(), "start": list(robot.read_once().q)}
count = 0
"""
FULL = """
import json, math
import numpy as np
import panda_py
panda = panda_py.Panda("HOST")
said = {"start": list(panda.get_state().q)}
"""


def run(begin: str, program: str, **options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    host = helpers_panda.host()
    twin = helpers_panda.twin(host=host, port=1337, **options)
    output = helpers_panda.serve(twin, begin.replace("HOST", host) + program + "\nprint(json.dumps(said))")
    return output, twin.metrics()


@pytest.mark.slow
def test_it_connects_reads_and_runs_torque_and_velocity_loops() -> None:
    output, metrics = run(
        BARE,
        """
def torque(state, period):
    global count
    count += 1
    wanted = [-2 * v for v in state.dq]
    wanted[3] += 0.5 * math.sin(count * 0.01)
    command = libfranka.Torques(wanted)
    command.motion_finished = count >= 1500
    return command
robot.control(torque)
said["after_torque"] = list(robot.read_once().q)
count = 0
def velocity(state, period):
    global count
    count += 1
    command = libfranka.JointVelocities([0.2 * math.sin(math.pi * count / 1000) ** 2] * 7)
    command.motion_finished = count >= 1000
    return command
robot.control_joint_velocity(velocity)
said["after_velocity"] = list(robot.read_once().q)
""",
    )
    assert output["version"] == 5
    np.testing.assert_allclose(output["start"], PANDA.home, atol=1e-4)
    moved = np.subtract(output["after_torque"], output["start"])
    assert 0.005 < moved[3] < 0.1
    np.testing.assert_allclose(np.subtract(output["after_velocity"], output["after_torque"]), 0.1, atol=0.005)
    assert metrics["setpoints"] >= 2500
    assert (metrics["reflexes"], metrics["packets_lost"]) == (0, 0)


@pytest.mark.slow
def test_a_jump_of_torque_is_a_reflex_that_recovery_clears() -> None:
    output, metrics = run(
        BARE,
        """
def jump(state, period):
    global count
    count += 1
    return libfranka.Torques([0.0] * 6 + [8.0 if count > 50 else 0.0])
try:
    robot.control(jump, False, 1000.0)
except Exception as error:
    said["error"] = str(error)
state = robot.read_once()
said["mode"], said["why"] = state.robot_mode.name, str(state.last_motion_errors)
robot.automatic_error_recovery()
count = 0
def still(state, period):
    global count
    count += 1
    command = libfranka.Torques([0.0] * 7)
    command.motion_finished = count >= 100
    return command
robot.control(still)
said["well"] = str(robot.read_once().current_errors)
""",
    )
    assert "controller_torque_discontinuity" in output["error"]
    assert output["mode"] == "kReflex"
    assert "controller_torque_discontinuity" in output["why"]
    assert output["well"] == "[]"
    assert metrics["reflexes"] == 1


def test_values_that_no_robot_takes_are_refused_in_libfrankas_words() -> None:
    output, _ = run(
        BARE,
        """
refused = {
    "load": lambda: robot.set_load(-1.0, [0.0] * 3, [0.0] * 9),
    "impedance": lambda: robot.set_joint_impedance([20000.0] * 7),
    "frame": lambda: robot.set_ee([2.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    "collision": lambda: robot.set_collision_behavior([20.0] * 7, [10.0] * 7, [20.0] * 6, [10.0] * 6),
}
for name, call in refused.items():
    try:
        call()
        said[name] = "taken"
    except Exception as error:
        said[name] = str(error)
robot.set_load(0.5, [0.0, 0.0, 0.05], [0.001, 0, 0, 0, 0.001, 0, 0, 0, 0.001])
said["mass"] = robot.read_once().m_load
""",
    )
    for name in ("load", "impedance", "frame", "collision"):
        assert "invalid argument" in output[name], name
    assert output["mass"] == pytest.approx(0.5)


def test_the_user_stop_is_told_in_libfrankas_words() -> None:
    output, _ = run(
        BARE,
        """
try:
    robot.control(lambda state, period: libfranka.Torques([0.0] * 7))
except Exception as error:
    said["error"] = str(error)
said["mode"] = robot.read_once().robot_mode.name
""",
        user_stop=[[0.5, 60.0]],
    )
    # The second where the machine was so slow that the stop came before the motion.
    assert "User Stop pressed" in output["error"] or '("User stopped")' in output["error"]
    assert output["mode"] == "kUserStopped"


@pytest.mark.slow
def test_its_own_motions_with_its_own_gains_use_the_model_that_the_robot_gave_it() -> None:
    """The arm as it is: rotors and the published friction."""
    output, metrics = run(
        FULL,
        """
state = panda.get_state()
model = panda.get_model()
said["mass"] = [float(m) for m in np.array(model.mass(state)).reshape(7, 7).diagonal()]
said["gravity"] = list(model.gravity(state))
goal = np.array(state.q) + 0.3 * np.array([1, -1, 1, -1, 1, 1, -1])
said["reached"] = panda.move_to_joint_position(goal)
said["off"] = float(np.abs(np.array(panda.get_state().q) - goal).max())
said["back"] = panda.move_to_start()
said["left"] = float(np.abs(np.array(panda.get_state().q) - said["start"]).max())
""",
        **helpers_panda.QUIET,
    )
    # Sheet panda, reference values at `ready`.
    np.testing.assert_allclose(output["mass"], [0.4612, 1.4450, 0.8789, 0.7887, 0.0279, 0.0326, 0.0049], atol=1e-3)
    np.testing.assert_allclose(output["gravity"], [0, -1.7714, -0.6440, 18.5736, 0.6338, 1.6937, 0], atol=0.02)
    assert output["reached"]
    assert output["off"] < 0.005
    assert output["back"]
    assert output["left"] < 0.005
    assert (metrics["reflexes"], metrics["packets_lost"]) == (0, 0)
    assert metrics["requests"]["LoadModelLibrary"] == 1
