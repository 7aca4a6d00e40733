"""The control laws of Kairos and MOCA compared with mink and pink: same arm and base, same errors of the tool.

Ours is what a cycle computes: forward kinematics, Jacobian and the law. The others update their configuration and solve
for a velocity with one frame task of the same weights and no limits, by DAQP. MOCA's law returns torques instead, so it
computes more: mass matrix, Coriolis forces, priorities. The agreement of the others' velocities with ours is printed,
too.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from bench.pairs import PAIRS, Row, measure
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA, SUMMIT_XL, UR16E, RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, mobile_model
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import add_arm

BLOCK = 200  # solves measured one after another
DT = 0.002  # s
PLACE = (0.2, 0.0, 0.529)  # m, of the arm's base on the mobile base, over the ground
POSTURES = 20


def run() -> list[Row]:
    """Compares Kairos and MOCA with both."""
    return [*_rows("kairos-clik", UR16E), *_rows("moca-impedance", PANDA)]


def _rows(name: str, robot: RobotDescription) -> list[Row]:
    ours = Ours(robot)
    others = {"mink": mink(robot), "pink": pink(robot)}

    pairs = measure(timed(ours, robot), {other: timed(solve, robot) for other, solve in others.items()}, PAIRS)
    rows = []
    for other, solve in others.items():
        what = f"{name}, a cycle's kinematics and law"
        if robot is UR16E:
            what += f"; velocities differ by {_apart(ours, solve, robot):.1%} at most"
        rows.append(pairs.row("superman-ik", what, "solve", other, "us"))
    return rows


Solve = Callable[[Array, Array, rotation.Quaternion], Array]
"""From the body's coordinates (3 + n,) and where the tool is meant to be (3,), w x y z, to velocities (3 + n,)."""


def _places(robot: RobotDescription) -> list[tuple[Array, Array, rotation.Quaternion]]:
    """Returns postures around the home posture, each with a target 1 cm and 0.01 rad away."""
    rng = np.random.default_rng(1)
    found = []
    ours = Ours(robot)
    for _ in range(POSTURES):
        q = np.concatenate([rng.uniform(-0.5, 0.5, 3), np.array(robot.home) + rng.uniform(-0.3, 0.3, robot.n)])
        place, turn = ours.tool(q)
        x, y, z = rng.normal(size=3) * 0.01
        found.append((q, place + rng.normal(size=3) * 0.01, rotation.product(rotation.exp(x, y, z), turn)))
    return found


def timed(solve: Solve, robot: RobotDescription) -> Callable[[], dict[str, float]]:
    """Returns what measures a block of solves, us, p50."""
    places = _places(robot)

    def block() -> dict[str, float]:
        took = []
        for i in range(BLOCK):
            q, place, turn = places[i % POSTURES]
            started = time.perf_counter_ns()
            solve(q, place, turn)
            took.append(time.perf_counter_ns() - started)
        return {"solve": statistics.median(took) / 1e3}

    return block


def _apart(one: Solve, other: Solve, robot: RobotDescription) -> float:
    """Returns the largest difference between two solutions, as a share of the velocity."""
    gaps = []
    for q, place, turn in _places(robot):
        a, b = one(q, place, turn), other(q, place, turn)
        gaps.append(float(np.linalg.norm(a - b) / np.linalg.norm(a)))
    return max(gaps)


class Ours:
    """Tool pose and a law of the robot.

    Without a law it is the robot's own; Kairos': gain 1 / DT and no priorities, the same problem as the others'.
    """

    def __init__(self, robot: RobotDescription, law: Controller | None = None) -> None:
        self._robot = robot
        self._tool = bound(ToolPose("tool", ToolPoseConfig(robot=robot.name)))
        if law is not None:
            self._law: Controller = bound(law)
        elif robot is UR16E:
            same = {"base": 1.0, "arm": 1.0, "posture": 0.0}
            options = {"gain": (1 / DT,) * 6, "manipulation": same, "manipulability": 0.0, "speed": None}
            self._law = bound(KairosClik("law", KairosClikConfig.model_validate(options)))
        else:
            self._law = bound(MocaImpedance("law", MocaImpedanceConfig()))
        self._started = False

    def tool(self, q: Array) -> tuple[Array, rotation.Quaternion]:
        self._place(q)
        x, y, z, *turn = self._tool.output["pose"].tolist()
        return np.array([x, y, z]), (turn[0], turn[1], turn[2], turn[3])

    def __call__(self, q: Array, place: Array, turn: rotation.Quaternion) -> Array:
        law = self._law
        self._place(q)
        law.input["desired_pose"][:3], law.input["desired_pose"][3:] = place, turn
        if not self._started:
            self._started = True
            law.reset()
        law.update(DT)
        if "velocity" not in law.output:
            return law.output["torque"]
        vx, vy, wz = law.output["base_twist"].tolist()
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([c * vx - s * vy, s * vx + c * vy, wz, *law.output["velocity"]])

    def _place(self, q: Array) -> None:
        tool, law = self._tool, self._law
        tool.input["q"][:] = law.input["q"][:] = q[3:]
        tool.input["base_pose"][:] = law.input["base_pose"][:] = q[:3]
        tool.update(DT)
        for name in ("pose", "jacobian", "twist"):
            if name in law.input:
                law.input[name][:] = tool.output[name]


def bound(controller: Controller) -> Controller:
    inputs, outputs = ({s.name: np.zeros(s.shape) for s in t} for t in (controller.inputs, controller.outputs))
    poses = {t.name: np.array(IDENTITY) for t in controller.transforms}
    if "mount" in poses:
        poses["mount"][:3] = PLACE
    controller.bind(inputs, outputs, {}, {p.name: np.array(p.default) for p in controller.parameters}, poses)
    return controller


def _costs() -> dict[str, float]:
    """Returns the roots of W_1's weights, because the others square their costs."""
    return {"position_cost": np.sqrt(1000.0), "orientation_cost": np.sqrt(500.0)}


def pink(robot: RobotDescription) -> Solve:
    """Returns pink's solver, on the model that ours uses."""
    import pinocchio as pin
    from pink import Configuration, solve_ik
    from pink.tasks import DampingTask, FrameTask

    mount = np.eye(4)
    mount[:3, 3] = PLACE
    model = mobile_model(SUMMIT_XL, robot, mount)
    configuration = Configuration(model, model.createData(), pin.neutral(model))
    task, damping = FrameTask(FLANGE, **_costs()), DampingTask(cost=1.0)

    def solve(q: Array, place: Array, turn: rotation.Quaternion) -> Array:
        configuration.update(q)
        task.set_target(pin.SE3(rotation.matrix(turn), place))
        found: Array = solve_ik(configuration, [task, damping], DT, solver="daqp", damping=0.0, limits=[])
        return found

    return solve


def mink(robot: RobotDescription) -> Solve:
    """Returns mink's solver, on the same arm in MuJoCo."""
    import mink
    import mujoco

    model = mujoco.MjModel.from_xml_string(_mjcf(robot))
    configuration = mink.Configuration(model)
    task = mink.FrameTask("arm/flange", "body", **_costs())
    damping = mink.DampingTask(model, cost=1.0)

    def solve(q: Array, place: Array, turn: rotation.Quaternion) -> Array:
        configuration.update(q)
        task.set_target(mink.SE3(np.array([*turn, *place])))
        found: Array = mink.solve_ik(configuration, [task, damping], DT, solver="daqp", damping=0.0, limits=[])
        return found

    return solve


def _mjcf(robot: RobotDescription) -> str:
    mjcf, root = Mjcf(), Element("mujoco")
    add(root, "compiler", angle="radian", autolimits=True)
    base = SubElement(mjcf.worldbody, "body", name="base")
    for name, kind, axis in (("x", "slide", (1, 0, 0)), ("y", "slide", (0, 1, 0)), ("yaw", "hinge", (0, 0, 1))):
        add(base, "joint", name=name, type=kind, axis=axis)
    add(base, "geom", type="box", size=(0.3, 0.3, 0.1), mass=100.0)
    x, y, z = PLACE
    add_arm(mjcf, base, robot, "arm", 0.1, 0.0, pos=(x, y, z))
    root.extend((mjcf.asset, mjcf.worldbody, mjcf.actuator))
    return tostring(root, encoding="unicode")
