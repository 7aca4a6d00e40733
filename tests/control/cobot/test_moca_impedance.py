"""MOCA's impedance: the paper's equations written densely, statics and motion in MuJoCo, switches at any instant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from helpers.control import bound
from helpers.superman import MASS, MOUNT, PANDA_DATA, PANDA_MODEL, MocaRig, task_inertia
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, eigh
from scipy.spatial.transform import Rotation

from srl.control.cobot.admittance import Admittance, AdmittanceConfig
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig, WeightedTorque
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.control.cobot.whole_body import WholeBody
from srl.drivers.base.config import BaseConfig
from srl.drivers.base.driver import MobileBase
from srl.drivers.panda.config import PandaConfig
from srl.drivers.panda.driver import Panda
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA

TOOL = bound(ToolPose("tool", ToolPoseConfig()), mount=MOUNT)


def inverse_mass(q: Array) -> Array:
    upper = np.triu(pin.crba(PANDA_MODEL, PANDA_DATA, q))
    return np.linalg.inv(upper + np.triu(upper, 1).T)


def posture(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Jacobian (6, 10), M (10, 10), J M^-1 (6, 10) of a random posture."""
    q = np.concatenate([rng.uniform(-3, 3, 3), rng.uniform(PANDA.q_lower, PANDA.q_upper)])
    body = WholeBody(PANDA, rotation.homogeneous(MOUNT), np.eye(4))
    body.update(q)
    M = block_diag(np.diag([MASS[0], MASS[0], MASS[1]]), np.linalg.inv(inverse_mass(q[3:])))
    return body.jacobian, M, body.jacobian @ np.linalg.inv(M)


def torques(J: Array, M: Array, F: Array, tau_0: Array, eta_B: float, eta_A: float) -> Array:
    law = WeightedTorque(7, MASS)
    law.take(J, np.linalg.inv(M[3:, 3:]))
    base, arm = law(F.tolist(), tau_0.tolist(), eta_B, eta_A)
    return np.concatenate([base, arm])


seeds = st.integers(0, 2**32 - 1)
etas = st.floats(-2, 2).map(lambda x: float(10**x))


@settings(max_examples=150, deadline=None)
@given(seeds, etas, etas)
def test_the_torques_give_the_force_asked_for_and_the_null_space_none(seed: int, eta_B: float, eta_A: float) -> None:
    rng = np.random.default_rng(seed)
    J, M, JMi = posture(rng)
    F, tau_0 = rng.normal(0, [50, 50, 50, 5, 5, 5]), rng.normal(0, 10, 7)
    inverted = np.linalg.inv(JMi @ J.T) @ JMi  # Jbar^T
    size = np.abs(F).max() + np.abs(inverted[:, 3:] @ tau_0).max()
    A = JMi @ np.diag([eta_B**-2.0] * 3 + [eta_A**-2.0] * 7) @ J.T
    scaled = A / np.sqrt(np.outer(np.diag(A), np.diag(A)))
    rounding = 1e-15 * np.linalg.cond(scaled) * size  # postures all but singular, weights all but one-sided
    np.testing.assert_allclose(
        inverted @ torques(J, M, F, tau_0, eta_B, eta_A), F, atol=max(1e-9, 100 * rounding), rtol=0
    )
    alone = torques(J, M, np.zeros(6), tau_0, eta_B, eta_A)
    np.testing.assert_allclose(inverted @ alone, 0, atol=max(1e-9, 100 * rounding))


@settings(max_examples=100, deadline=None)
@given(seeds, st.sampled_from([(5.0, 1.0), (1.0, 6.0), (1.0, 1.0)]))
def test_they_are_equation_4_written_densely(seed: int, eta: tuple[float, float]) -> None:
    rng = np.random.default_rng(seed)
    J, M, JMi = posture(rng)
    F, tau_0 = rng.normal(0, [50, 50, 50, 5, 5, 5]), np.concatenate([np.zeros(3), rng.normal(0, 10, 7)])
    H = np.diag([eta[0]] * 3 + [eta[1]] * 7)
    W = H.T @ np.linalg.inv(M) @ H  # (6)
    WiMi = np.linalg.inv(W) @ np.linalg.inv(M)
    inertia = np.linalg.inv(JMi @ J.T)  # Lambda
    weighted = np.linalg.inv(JMi @ WiMi @ J.T)  # Lambda_W
    tau = WiMi @ J.T @ weighted @ np.linalg.inv(inertia) @ F + tau_0 - WiMi @ J.T @ weighted @ JMi @ tau_0
    np.testing.assert_allclose(torques(J, M, F, tau_0[3:], *eta), tau, rtol=1e-6, atol=1e-6)


def test_eta_decides_who_moves() -> None:
    """Accelerations of the base's point and of the arm's tip relative to it, for the same force."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        J, M, _ = posture(rng)
        shares = []
        for eta in ((30.0, 1.0), (1.0, 30.0)):
            acceleration = np.linalg.solve(M, torques(J, M, np.array([10.0, 5, 0, 0, 0, 0]), np.zeros(7), *eta))
            base, arm = J[:2, :3] @ acceleration[:3], J[:2, 3:] @ acceleration[3:]
            shares.append(np.linalg.norm(base) / (np.linalg.norm(base) + np.linalg.norm(arm)))
        assert shares[0] < shares[1]
        assert shares[0] < 0.05


def law(q: Array = PANDA.home, yaw: float = 0.0, **options: Any) -> MocaImpedance:
    """At rest, with its inputs as `tool-pose` gives them, and nothing wired to its outputs' devices but the base."""
    controller = bound(MocaImpedance("moca", MocaImpedanceConfig(**options)))
    controller.applied = {**controller.applied, "base_twist": np.zeros(3)}
    place(controller, q, yaw)
    controller.input["desired_pose"][:] = controller.input["pose"]
    controller.reset()
    return controller


def place(controller: MocaImpedance, q: Array, yaw: float = 0.0) -> None:
    tool = TOOL
    tool.input["q"][:] = controller.input["q"][:] = q
    tool.input["base_pose"][2] = controller.input["base_pose"][2] = yaw
    tool.update(0.0)
    for name, array in tool.output.items():
        controller.input[name][:] = array


def test_it_begins_with_nothing_on_top_of_gravity_compensation() -> None:
    controller = law()
    for name in ("torque", "base_twist", "force"):
        np.testing.assert_allclose(controller.output[name], 0, atol=1e-12)
    here = law(gravity="here")
    np.testing.assert_allclose(
        here.output["torque"], pin.computeGeneralizedGravity(PANDA_MODEL, PANDA_DATA, PANDA.home), atol=1e-12
    )


@pytest.mark.parametrize(("unit_mass", "rotors"), [(True, "none"), (False, "none"), (False, "damping"), (False, "all")])
def test_the_force_is_equation_8_on_so3(unit_mass: bool, rotors: str) -> None:
    """As published, and with the damping for the masses that move."""
    controller, xi = law(unit_mass=unit_mass, rotors=rotors), 0.7
    turn = np.array([0.2, -0.1, 0.15])
    pose = controller.input["pose"]
    actual = Rotation.from_quat(pose[[4, 5, 6, 3]])
    away, v = np.array([0.01, -0.02, 0.03]), np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.4])
    controller.input["desired_pose"][:3] = pose[:3] + away
    controller.input["desired_pose"][3:] = (Rotation.from_rotvec(turn) * actual).as_quat()[[3, 0, 1, 2]]
    controller.input["desired_twist"][:] = 2 * v
    controller.input["twist"][:] = v
    controller.update(1e-3)
    K = np.diag([500.0, 500, 500, 30, 30, 30])
    D = 2 * xi * np.sqrt(K)
    if not unit_mass:
        inertia = task_inertia(PANDA.home, controller.input["jacobian"], rotors != "none")
        squares, V = eigh(K, inertia)  # K v = w^2 Lambda v with V' Lambda V = 1
        D = inertia @ V @ np.diag(2 * xi * np.sqrt(squares)) @ V.T @ inertia
    np.testing.assert_allclose(controller.output["force"], K @ np.concatenate([away, turn]) + D @ v, atol=1e-9)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, -2.0])
def test_the_base_is_a_damped_mass_in_its_own_frame(yaw: float) -> None:
    """A constant pull: the base ends at tau_v / D_v, whichever way it looks."""
    controller = law(yaw=yaw, manipulation={"base": 0.01, "arm": 1, "posture": 0})  # all but the base's work
    controller.input["desired_pose"][:2] += [0.1, -0.05]
    for _ in range(2000):
        controller.update(1e-3)
        controller.applied["base_twist"][:] = controller.output["base_twist"]
    c, s = np.cos(yaw), np.sin(yaw)
    vx, vy, wz = controller.output["base_twist"]
    J, F = controller.input["jacobian"], controller.output["force"]
    tau_v = torques(
        J, block_diag(np.diag([105, 105, 21]), np.linalg.inv(inverse_mass(PANDA.home))), F, np.zeros(7), 0.01, 1
    )
    np.testing.assert_allclose([c * vx - s * vy, s * vx + c * vy], tau_v[:2] / 1050, rtol=1e-6)
    assert wz == pytest.approx(tau_v[2] / 210, rel=1e-6)


def test_a_base_that_does_not_move_is_not_wound_up() -> None:
    controller = law()
    controller.input["desired_pose"][0] += 0.2
    seen = []
    for _ in range(3000):
        controller.update(1e-3)  # the guard lets nothing through
        seen.append(controller.output["base_twist"].copy())
    assert np.abs(seen).max() < 1e-3
    np.testing.assert_allclose(seen[-1], seen[0], atol=1e-12)


def test_posture_is_captured_at_the_switch_to_locomotion_and_comes_in_without_a_step() -> None:
    controller, moved = law(), PANDA.home + 0.3
    place(controller, moved)
    controller.input["desired_pose"][:] = controller.input["pose"]
    controller.update(1e-3)
    before = controller.output["torque"].copy()
    assert np.abs(before).max() > 0.1  # 5 N m/rad towards where it started
    controller.input["modes"][3] = 1
    for _ in range(600):
        controller.update(1e-3)
        assert np.abs(controller.output["torque"] - before).max() < 0.05
        before = controller.output["torque"].copy()
    np.testing.assert_allclose(before, 0, atol=1e-9)  # here is where it likes to be
    away = PANDA.home + 0.4
    place(controller, away)
    controller.input["desired_pose"][:] = controller.input["pose"]
    controller.update(1e-3)
    J, Mi = controller.input["jacobian"], inverse_mass(away)
    M = block_diag(np.diag([105, 105, 21]), np.linalg.inv(Mi))
    want = torques(J, M, np.zeros(6), 50 * (moved - away), 1, 6)
    np.testing.assert_allclose(controller.output["torque"], want[3:], atol=1e-6)


@pytest.mark.slow
def test_a_straight_arm_and_a_wrist_in_line_leave_the_torques_bounded_and_smooth() -> None:
    """From far inside through the singular posture, pulled and turned all the time."""
    for start, end in (
        ([0, 0.2, 0, -0.5, 0, 1.0, 0], [0, 0.2, 0, 0.05, 0, 1.0, 0]),  # elbow (beyond its end stop)
        ([0, 0.1, 0, -1.0, 0, 0.4, 0], [0, 0.1, 0, -1.0, 0, -0.1, 0]),  # wrist
        ([0, -0.3, 0, -0.6, 0, 0.9, 0], [0, 0.0, 0, -0.0, 0, 0.0, 0]),  # all in one line
    ):
        for mode in (0.0, 1.0):
            controller = law(np.array(start))
            controller.input["modes"][3] = mode
            last, steps, sizes = None, [], []
            for share in np.linspace(0, 1, 3000):
                place(controller, (1 - share) * np.array(start) + share * np.array(end))
                pose = controller.input["pose"]
                controller.input["desired_pose"][:] = pose
                controller.input["desired_pose"][:3] += [0.02, 0.03, 0.05]
                controller.update(1e-3)
                tau = controller.output["torque"].copy()
                sizes.append(np.abs(tau).max())
                if last is not None:
                    steps.append(np.abs(tau - last).max())
                last = tau
            assert np.isfinite(sizes).all()
            assert max(sizes) < 87
            assert max(steps) < 1.0  # N m a millisecond: what the robot's torque rate allows


@pytest.mark.slow
def test_a_blocked_tip_is_pushed_with_a_bounded_force() -> None:
    """The admittance's leash lets the reference run ahead by 3 cm and a little more."""
    rig = MocaRig()
    measured = rig._measured()
    rig.chain.press("A")
    for _ in range(5000):
        rig.chain.wrench[2] = 20  # along the tool's own z
        rig.chain.update(*measured, 1e-3)  # nothing moves
        rig.chain.press()
    assert 10 < np.linalg.norm(rig.chain.law.output["force"][:3]) < 30


# -- in MuJoCo


@pytest.mark.slow
def test_a_steady_force_gives_the_displacement_of_the_papers_statics() -> None:
    """K^-1 Lambda Lambda_a^-1 f: external torque acts on the arm alone (eq. 3)."""
    rig = MocaRig(admittance={"leash": None})  # a force beyond the leash's reach would pull the reference along
    rig.step(200)
    start, f = rig.tip, np.array([12.0, -6.0, 9.0, 0, 0, 0])
    rig.push[:] = f
    rig.step(5000)
    J, q = rig.chain.law.input["jacobian"], rig.arm.position
    Mi = block_diag(np.diag([1 / 105, 1 / 105, 1 / 21]), inverse_mass(q))
    own = J[:, 3:] @ Mi[3:, 3:] @ J[:, 3:].T
    want = (np.linalg.inv(J @ Mi @ J.T) @ own @ f)[:3] / 500
    assert np.abs(rig.arm.velocity).max() < 2e-3
    assert np.linalg.norm(rig.tip - start - want) < 0.02 * np.linalg.norm(want)
    assert np.linalg.norm(want) < np.linalg.norm(f[:3]) / 500


@pytest.mark.slow
def test_manipulation_spares_the_base_and_locomotion_the_arm() -> None:
    moved = []
    for mode in ("", "P"):
        rig = MocaRig()
        if mode:
            rig.chain.press(mode)
            rig.step()
            rig.chain.press()
        rig.step(700)
        q, base = rig.arm.position, rig.base.pose()
        rig.chain.press("A")
        for _ in range(1500):
            rig.chain.wrench[:3] = 15 * np.array([0, 1.0, 0])
            rig.step()
            rig.chain.press()
        moved.append((np.linalg.norm(rig.base.pose()[:2] - base[:2]), np.abs(rig.arm.position - q).max()))
    assert moved[0][0] < 0.03 < 0.1 < moved[1][0]
    assert moved[1][1] < 0.5 * moved[0][1]


@pytest.mark.slow
def test_buttons_at_any_instant_make_no_step() -> None:
    rng = np.random.default_rng(11)
    rig = MocaRig(payload={"mass": 1.0})
    rig.chain.press("A")
    rig.step()
    torque, base = [], []
    for k in range(6000):
        if k % 30 == 0:
            names = [name for name in "AMGP" if rng.random() < 0.15]
            rig.chain.press(*names)
        if k % 100 == 0:
            rig.chain.wrench[:] = rng.normal(0, [10, 10, 10, 0.5, 0.5, 0.5])
        rig.step()
        torque.append(rig.chain.law.output["torque"].copy())
        base.append(rig.chain.law.output["base_twist"].copy())
    assert sum(rig.chain.keys.metrics()["presses"].values()) > 40  # type: ignore[attr-defined]
    assert np.isfinite(torque).all()
    assert np.abs(np.diff(torque, axis=0)).max() < 1.0  # N m in 1 ms: the arm's torque rate
    assert np.abs(np.diff(base, axis=0)).max() / 1e-3 < 3.0  # m/s^2, rad/s^2
    assert rig.chain.law.metrics()["near_singular"] == 0


def test_signals_fit_the_devices() -> None:
    arm = Panda("arm", PandaConfig(port="tcp://127.0.0.1:1337"))
    base = MobileBase("base", BaseConfig(port="tcp://127.0.0.1:7447"))
    devices = {f"{d.name}.{s.name}": (s.shape, s.unit) for d in (arm, base) for s in (*d.states, *d.commands)}
    law = MocaImpedance("moca", MocaImpedanceConfig())
    tool = ToolPose("tool", ToolPoseConfig())
    hand = Admittance("admittance", AdmittanceConfig())
    ports = {
        f"{c.name}.{s.name}": (s.shape, s.unit) for c in (law, tool, hand) for s in (*c.outputs, *c.inputs)
    }  # an input wins over an output of the same name; they are alike
    for port, device in {
        "moca.q": "arm.position", "moca.qd": "arm.velocity", "moca.torque": "arm.torque_command",
        "moca.base_pose": "base.pose", "moca.base_twist": "base.twist_command", "tool.q": "arm.position",
        "tool.qd": "arm.velocity", "tool.base_pose": "base.pose", "tool.base_twist": "base.twist",
    }.items():  # fmt: skip
        assert ports[port] == devices[device], port
    for ours, theirs in {
        "moca.pose": "tool.pose", "moca.twist": "tool.twist", "moca.jacobian": "tool.jacobian",
        "moca.desired_pose": "admittance.pose", "moca.desired_twist": "admittance.twist",
        "admittance.pose": "tool.pose", "admittance.twist": "tool.twist",
    }.items():  # fmt: skip
        assert ports[ours] == ports[theirs], ours
