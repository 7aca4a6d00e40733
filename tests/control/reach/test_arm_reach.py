"""The law `arm-reach`: goals of joints and tool, round what stands, within limits, and what it does where it can't."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from helpers.arm_urdf import HIP

from srl.control.cobot.robot_distances import RobotDistances
from srl.control.reach.arm_law import ArmReach
from srl.control.reach.arm_options import ArmReachConfig
from srl.control.reach.mode import Mode
from srl.control.reach.static import FLOOR
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots import PANDA
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.runtime.profile import profile as profiles
from srl.runtime.profile.profile import find
from srl.testing import ControllerConformance, Lab, bound

DT = 0.01
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
POST = {"position": [0.45, 0.0, 0.4], "radius": 0.06, "length": 0.8}
ASIDE, LOWER = np.array([0.7, 0, 0, 0, 0, 0, 0]), np.array([0, 0.3, 0, 0.4, 0, 0, 0])
START, BEYOND = HOME + LOWER + ASIDE, HOME + LOWER - ASIDE
ACCELERATION = 2.0


def law(target: str = "joints", q: Any = START, **options: Any) -> ArmReach:
    given = {"robot": "panda", "target": target, "distances": {"obstacles": {"post": POST}}} | options
    made = bound(ArmReach("reach", ArmReachConfig.model_validate(given)))
    made.input["target"][:] = np.nan
    put(made, np.asarray(q, float), np.zeros(7))
    made.reset()
    return made


def put(made: ArmReach, q: Any, v: Any) -> None:
    """The arm is here, and obeyed."""
    made.input["q"][:] = q
    for name, value in (("q", q), ("velocity", v)):
        if name in made.applied:
            made.applied[name][:] = value


def oracle(made: ArmReach) -> RobotDistances:
    return RobotDistances(PANDA, None, made.options.distances)


def state(made: ArmReach) -> Mode:
    return Mode(int(made.output["state"][0]))


def run(made: ArmReach, cycles: int, until: Mode | None = None) -> tuple[np.ndarray, list[Mode]]:
    """Where the joints went, and the states, of an arm that obeys."""
    path, states = [], []
    for _ in range(cycles):
        made.update(DT)
        if "velocity" in made.output:
            v = made.output["velocity"].copy()
            q = made.input["q"] + v * DT
        else:
            q, v = made.output["q"].copy(), made.output["q_velocity"].copy()
        put(made, q, v)
        path.append(q)
        states.append(state(made))
        if states[-1] is until:
            break
    return np.array(path), states


def keeps_its_limits(made: ArmReach, path: np.ndarray) -> None:
    v = np.diff(path, axis=0) / DT
    assert (np.abs(v) <= 0.5 * PANDA.dq_max * (1 + 1e-6)).all()
    assert np.abs(np.diff(v, axis=0)).max() <= ACCELERATION * DT * 1.3


class TestContract(ControllerConformance):
    inputs = {"q": START, "target": BEYOND}  # noqa: RUF012

    def law(self) -> ArmReach:
        return bound(ArmReach("reach", ArmReachConfig.model_validate({"robot": "panda"})))


@pytest.mark.parametrize("command", ["position", "velocity"])
def test_it_goes_round_a_post_and_keeps_off_it(command: str) -> None:
    made = law(command=command)
    made.input["target"][:] = BEYOND
    path, states = run(made, 3000, Mode.ARRIVED)
    assert states[-1] is Mode.ARRIVED
    assert Mode.AROUND in states
    assert path[-1] == pytest.approx(BEYOND, abs=1e-2 if command == "velocity" else 1e-9)
    apart = oracle(made)
    assert min(apart.margin(q) for q in path) >= -FLOOR / 2
    assert min(apart.margin(START + t * (BEYOND - START)) for t in np.linspace(0, 1, 100)) < -0.03, "nothing was shown"
    keeps_its_limits(made, path)


def test_without_obstacles_it_goes_straight() -> None:
    made = law(distances={})
    made.input["target"][:] = BEYOND
    path, states = run(made, 1000, Mode.ARRIVED)
    assert states[-1] is Mode.ARRIVED
    assert Mode.AROUND not in states
    along = (path - START) @ (BEYOND - START) / np.sum((BEYOND - START) ** 2)
    assert np.abs(path - START - along[:, None] * (BEYOND - START)).max() < 1e-9
    assert (np.diff(along) >= -1e-12).all()


@pytest.mark.parametrize("target", ["point", "pose"])
def test_its_tool_goes_to_a_place(target: str) -> None:
    """The oracle is Pinocchio's own model."""
    made = law(target)
    model = pinocchio_model(PANDA)
    data = model.createData()

    def tool(q: np.ndarray) -> Any:
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[model.getFrameId(FLANGE)].copy()

    goal = tool(BEYOND)
    made.input["target"][:3] = goal.translation
    if target == "pose":
        x, y, z, w = pin.Quaternion(goal.rotation).coeffs().tolist()
        made.input["target"][3:] = w, x, y, z
    path, states = run(made, 4000, Mode.ARRIVED)
    assert states[-1] is Mode.ARRIVED
    reached = tool(path[-1])
    assert reached.translation == pytest.approx(goal.translation, abs=2e-3)
    if target == "pose":
        assert np.linalg.norm(pin.log3(reached.rotation.T @ goal.rotation)) < 0.01
    assert min(oracle(made).margin(q) for q in path) >= -FLOOR / 2


def test_a_place_out_of_reach_is_said_and_nothing_moves() -> None:
    made = law("point")
    made.input["target"][:] = 2.0, 0.0, 0.5
    path, states = run(made, 260)
    assert states[-1] is Mode.UNREACHABLE
    assert (path == START).all()


def test_a_goal_within_the_post_waits() -> None:
    made = law()
    inside = next(
        q for q in np.linspace(START, BEYOND, 60) if oracle(made).margin(q) < -0.05
    )  # fmt: skip
    made.input["target"][:] = inside
    path, states = run(made, 50)
    assert states[-1] is Mode.WAITING
    assert (path == START).all()
    assert made.output["margin"][1] < 0.0 < made.output["margin"][0]


def test_a_new_goal_on_the_way_brakes_first_and_then_goes_there() -> None:
    made = law(distances={})
    made.input["target"][:] = BEYOND
    first, _ = run(made, 60)
    made.input["target"][:] = HOME
    second, states = run(made, 2000, Mode.ARRIVED)
    path = np.vstack([first, second])
    assert path[-1] == pytest.approx(HOME, abs=1e-9)
    keeps_its_limits(made, path)
    assert Mode.SEARCHING in states


def test_what_holds_the_arm_back_makes_no_jump() -> None:
    made = law(distances={})
    made.input["target"][:] = BEYOND
    run(made, 60)
    q = made.input["q"].copy()
    for k in range(50):  # the guard lets nothing through
        made.update(DT)
        put(made, q, np.zeros(7))
        assert k == 0 or np.abs(made.output["q"] - q).max() <= ACCELERATION * DT * DT * 1.5
    path, states = run(made, 2000, Mode.ARRIVED)
    assert states[-1] is Mode.ARRIVED
    keeps_its_limits(made, np.vstack([[q], path]))


def test_it_looks_at_few_postures_a_cycle() -> None:
    made = law(postures=3)
    looked: list[int] = []
    own = made._room  # the planner's only way to distances
    made._room = lambda point: (looked.append(1), own(point))[1]  # type: ignore[method-assign]
    made.input["target"][:] = BEYOND
    for _ in range(300):
        looked.clear()
        made.update(DT)
        put(made, made.output["q"].copy(), made.output["q_velocity"].copy())
        assert len(looked) <= 3 + 2


def test_from_what_is_too_near_it_goes_out_first() -> None:
    made = law()
    grid = np.linspace(START, BEYOND, 400)
    near = next(q for q in grid if -0.02 < oracle(made).margin(q) < -0.005)
    made = law(q=near)
    made.input["target"][:] = START
    path, states = run(made, 3000, Mode.ARRIVED)
    assert states[0] in (Mode.SEARCHING, Mode.LEAVING)
    assert Mode.LEAVING in states
    assert states[-1] is Mode.ARRIVED
    margins = [oracle(made).margin(q) for q in path]
    assert min(margins) >= oracle(made).margin(near) - 1e-6


def test_after_a_reset_it_stays_until_another_goal_comes() -> None:
    made = law()
    made.input["target"][:] = BEYOND
    run(made, 30)
    made.reset()
    path, states = run(made, 30)
    assert set(states) == {Mode.NO_GOAL}
    assert np.ptp(path, axis=0).max() == 0.0
    made.input["target"][0] += 0.01
    assert run(made, 3)[1][-1] is Mode.SEARCHING


def test_lost_joints_stop_it_and_it_goes_on_from_where_it_is() -> None:
    made = law(distances={})
    made.input["target"][:] = BEYOND
    run(made, 60)
    q = made.input["q"].copy()
    made.input["q"][:] = np.nan
    for k in range(30):
        made.update(DT)
        assert np.isnan(made.output["q"]).all()
        assert made.lost is (k >= 20) or k == 19
    put(made, q, np.zeros(7))
    path, states = run(made, 2000, Mode.ARRIVED)
    assert not made.lost
    assert states[-1] is Mode.ARRIVED
    keeps_its_limits(made, np.vstack([[q], path]))


@pytest.mark.parametrize(("joint", "share"), [(0, 0.0), (3, 0.0), (3, 0.2)])
def test_a_guard_that_holds_or_slows_one_joint_doesnt_lead_it_into_the_post(joint: int, share: float) -> None:
    """The guard takes each joint by itself: it lets this one only so far."""
    made = law()
    made.input["target"][:] = BEYOND
    apart, q, margins = oracle(made), START.copy(), []
    for _ in range(2500):
        made.update(DT)
        step = np.clip(made.output["q"] - q, -PANDA.dq_max * DT, PANDA.dq_max * DT)
        step[joint] *= share
        q = q + step
        put(made, q, step / DT)
        margins.append(apart.margin(q))
    assert min(margins) >= -0.01


def test_what_was_searched_from_elsewhere_isnt_gone() -> None:
    made = law()
    made.input["target"][:] = BEYOND
    for _ in range(4):
        made.update(DT)
    moved = START + np.array([0.15, -0.2, 0.0, 0.1, 0.0, 0.0, 0.0])
    put(made, moved, np.zeros(7))
    path, states = run(made, 3000, Mode.ARRIVED)
    assert states[-1] is Mode.ARRIVED
    assert min(oracle(made).margin(q) for q in path) >= -FLOOR / 2


def test_a_goal_that_moves_nothing_near_is_gone_to_all_the_same() -> None:
    """Of an SO-101 only the gripper's goal changes: little hangs on it."""
    robot = profiles.load("so101")[0].models["arm"].robot
    made = bound(ArmReach("reach", ArmReachConfig.model_validate({"robot": robot})))
    made.input["target"][:] = np.nan
    put(made, np.zeros(6), np.zeros(6))
    made.reset()
    made.input["target"][:] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]
    assert run(made, 500, Mode.ARRIVED)[1][-1] is Mode.ARRIVED


def test_obstacles_without_shapes_are_refused() -> None:
    text = re.sub(r"<collision>.*?</collision>", "", HIP, flags=re.DOTALL)
    bare = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), text.encode()), "tip": "tool"}).robot
    with pytest.raises(OptionError, match="no link of the robot has a shape"):
        law(q=np.zeros(bare.n), robot=bare, distances={"obstacles": {"post": POST}})


def test_a_quaternions_sign_and_noise_are_no_new_goal_and_a_goal_beyond_the_limits_is_unreachable() -> None:
    made = law("pose", distances={})
    made.input["target"][:] = 0.4, 0.2, 0.5, 0.0, 1.0, 0.0, 0.0
    run(made, 300)
    for k in range(200):
        made.input["target"][:] = [0.4, 0.2, 0.5, 0.0, 1.0, 0.0, 0.0]
        made.input["target"][3:] *= -1.0 if k % 2 else 1.0
        made.input["target"][0] += 0.0005 * (-1) ** k
        made.update(DT)
        put(made, made.output["q"].copy(), made.output["q_velocity"].copy())
    assert state(made) in (Mode.DIRECT, Mode.AROUND, Mode.ARRIVED)
    beyond = law()
    beyond.input["target"][:] = [9.0, *HOME[1:]]
    assert run(beyond, 5)[1][-1] is Mode.UNREACHABLE


@pytest.mark.parametrize("lag", [0.05, 0.1])
def test_a_lagging_velocity_arm_comes_there_without_jumps(lag: float) -> None:
    made = law(command="velocity", distances={})
    made.input["target"][:] = BEYOND
    q, v, commands = START.copy(), np.zeros(7), [np.zeros(7)]
    for _ in range(900):
        made.update(DT)
        command = made.output["velocity"].copy()
        commands.append(command)
        v = v + (command - v) * DT / (lag + DT)
        q = q + v * DT
        put(made, np.round(q / 0.00153) * 0.00153, command)  # what its encoder resolves
    assert state(made) is Mode.ARRIVED
    assert np.abs(np.diff(commands, axis=0)).max() <= 4 * ACCELERATION * DT


PROFILE_LINES: dict[str, Any] = {
    "use": "arm-reach",
    "name": "reach",
    "robot": "arm",
    "acceleration": 1.5,
    "joint_speed": 0.1,
    "distances": {"least": 0.02, "obstacles": {"bin": {"position": [0.22, 0.0, 0.1], "size": [0.02, 0.02, 0.2]}}},
    "in": {"q": "arm.position", "target": "client.position"},
    "out": {"q": "arm.position_command", "q_velocity": "arm.position_command.velocity"},
}


@pytest.mark.slow
def test_a_shipped_arm_uses_it_by_a_profile_line() -> None:
    """An SO-101 on its simulated servos."""
    _, text, folder = find("so101")
    profile = yaml.safe_load(text)
    profile["models"]["arm"]["urdf"] = str(folder / "so101.urdf")
    profile["controllers"] = [PROFILE_LINES]
    with Lab(profile) as lab:
        lab.setpoint("client.position", lab["arm.position"])  # active with the first one, which isn't a goal
        lab.run(0.2)
        target = lab["arm.position"] + [0.4, 0.1, -0.1, 0.1, 0.2, 0.0]
        lab.setpoint("client.position", target)
        lab.until(lambda: lab["reach.state"] == Mode.ARRIVED, most=20.0)
        lab.run(0.5)
        assert lab["arm.position"] == pytest.approx(target, abs=0.05)
        assert lab.state == "active"
