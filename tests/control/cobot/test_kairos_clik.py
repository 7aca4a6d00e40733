"""Kairos' inverse kinematics: the paper's equations written densely, convergence, singular postures."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.superman import MOUNT, KairosRig
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.runtime.contracts.signals import Array, Command, Kind, Limits
from srl.runtime.guard.velocity import VelocityGuard
from srl.runtime.models.robots import UR16E

STRAIGHT = np.array([0.0, -1.2, 0.0, -1.4, -1.2, 0.0])
W_1 = np.diag([1000.0] * 3 + [500.0] * 3)
TOOL = bound(ToolPose("tool", ToolPoseConfig(robot="ur16e")), mount=MOUNT)
FREE: dict[str, Any] = {"speed": None}


def law(q: Array = UR16E.home, base: Any = (0.0, 0.0, 0.0), **options: Any) -> KairosClik:
    controller = bound(KairosClik("kairos", KairosClikConfig(**options)))
    place(controller, q, base)
    controller.input["desired_pose"][:] = controller.input["pose"]
    controller.reset()
    return controller


def place(controller: KairosClik, q: Array, base: Any = (0.0, 0.0, 0.0)) -> None:
    tool = TOOL
    tool.input["q"][:] = controller.input["q"][:] = q
    tool.input["base_pose"][:] = controller.input["base_pose"][:] = base
    tool.update(0.0)
    for name, array in tool.output.items():
        if name in controller.input:
            controller.input[name][:] = array


def world(controller: KairosClik) -> Array:
    """The command (9,) with the base's part in the world's axes."""
    yaw = controller.input["base_pose"][2]
    turn = Rotation.from_euler("z", yaw).as_matrix()
    return np.concatenate([turn @ controller.output["base_twist"], controller.output["velocity"]])


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([(100.0, 1.0, 0.0), (10.0, 0.5, 1.0)]))
def test_it_is_the_papers_equations_written_densely(seed: int, weights: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(seed)
    w_b, w_a, k_i = weights
    start, q, base = rng.uniform(-3, 3, 6), rng.uniform(-3, 3, 6), rng.uniform(-3, 3, 3)
    controller = law(start, base, **FREE)
    controller.input["modes"][3] = k_i
    controller.reset()  # prefers `start` from here on
    place(controller, q, base)
    pose, twist = controller.input["pose"], rng.normal(0, 0.3, 6)
    away, turn = rng.normal(0, 0.05, 3), rng.normal(0, 0.2, 3)
    actual = Rotation.from_quat(pose[[4, 5, 6, 3]])
    controller.input["desired_pose"][:3] = pose[:3] + away
    controller.input["desired_pose"][3:] = (Rotation.from_rotvec(turn) * actual).as_quat()[[3, 0, 1, 2]]
    controller.input["desired_twist"][:] = twist
    controller.update(2e-3)
    J = controller.input["jacobian"]
    w = np.sqrt(max(np.linalg.det(J[:, 3:] @ J[:, 3:].T), 0))  # (12)
    k = 1 + 2 * (1 - w / 0.001) ** 2 if w <= 0.001 else 1  # (13)
    assert controller.output["manipulability"][0] == pytest.approx(w, rel=1e-3, abs=1e-7)
    W_2 = np.diag([w_b] * 3 + [w_a * k**2] * 6)
    inverse = np.linalg.solve(J.T @ W_1 @ J + W_2, J.T @ W_1)
    x = twist + np.array([0.5, 0.5, 0.5, 0.05, 0.01, 0.01]) * np.concatenate([away, turn])
    second = np.concatenate([np.zeros(3), k_i * (start - q)])
    want = inverse @ x + second - inverse @ J @ second  # (14), (10), (17)
    np.testing.assert_allclose(world(controller), want, rtol=1e-5, atol=1e-7)


@given(st.floats(0, 0.003))
def test_damping_grows_below_the_threshold_as_equation_13_says(w: float) -> None:
    controller = law()
    Ja = np.eye(6)
    Ja[0, 0] = w
    k = 1 + 2 * (1 - w / 0.001) ** 2 if w <= 0.001 else 1.0
    assert controller._damping(Ja) == pytest.approx(k, abs=1e-12)


def test_it_begins_at_rest() -> None:
    for mode in (0.0, 1.0):
        controller = law()
        controller.input["modes"][3] = mode
        controller.reset()
        np.testing.assert_allclose(world(controller), 0, atol=1e-12)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_it_converges_within_the_horizon_of_its_gains() -> None:
    """exp(-K t), but for the percent that W_2 takes: 0.5 rad at K = 0.01 needs 625 s to come below 0.001."""
    rig = KairosRig(rate=20)
    rig.chain.locked = True
    pose = rig.chain.law.input["pose"].copy()
    actual = Rotation.from_quat(pose[[4, 5, 6, 3]])
    there = pose[:3] + np.array([0.1, -0.15, 0.05])
    goal = np.concatenate([there, (Rotation.from_rotvec([0.2, 0.3, 0.35]) * actual).as_quat()[[3, 0, 1, 2]]])
    rig.chain.law.input["desired_pose"][:] = goal

    def error() -> tuple[float, float]:
        found = rig.chain.law.input["pose"]
        turn = Rotation.from_quat(goal[[4, 5, 6, 3]]) * Rotation.from_quat(found[[4, 5, 6, 3]]).inv()
        return float(np.linalg.norm(goal[:3] - found[:3])), float(turn.magnitude())

    rig.step(15 * 20)
    assert error()[0] < 2e-3  # 0.19 m at 0.5 per second
    rig.step(620 * 20)
    assert error()[0] < 1e-4
    assert error()[1] < 1.5e-3
    assert log(0.5 / 1e-3) / 0.01 < 635


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, FREE], ids=["slowed", "as published"])
@pytest.mark.parametrize("locomotion", [False, True])
def test_a_tool_pulled_through_the_straight_arm_stays_bounded(options: dict[str, Any], locomotion: bool) -> None:
    """Desired motion out of reach, up and out; W_2 bounds |q_d| by sqrt(W_1 / W_2) / 2 for each unit of task."""
    rig = KairosRig(**options)
    rig.chain.locked = True
    rig.chain.press("P" if locomotion else "")
    desired, twist = rig.chain.law.input["desired_pose"], np.array([0.1, 0.05, 0.15, 0, 0, 0])
    least, seen, steps, before = 1.0, [], [], np.zeros(6)
    for _ in range(3500):
        desired[:3] += rig.dt * twist[:3]
        rig.chain.law.input["desired_twist"][:] = twist
        rig.step()
        command = rig.chain.law.output["velocity"].copy()
        least = min(least, rig.chain.law.output["manipulability"][0])
        seen.append(np.abs(command).max())
        steps.append(np.abs(command - before).max())
        before = command
    assert np.isfinite(seen).all()
    assert least < 0.002
    if options:
        assert max(seen) < np.sqrt(1000 / 0.5) / 2 * 2
    else:
        assert (np.abs(before) <= UR16E.dq_max + 1e-9).all()
        assert max(seen) <= UR16E.dq_max.max() + 1e-9


@pytest.mark.slow
def test_a_singular_start_gets_away_bounded() -> None:
    for q in (np.zeros(6), np.array([0, -np.pi / 2, 0, -np.pi / 2, 0, 0]), STRAIGHT):
        rig = KairosRig(q)
        rig.chain.locked = True
        start = rig.chain.law.input["pose"].copy()
        rig.chain.law.input["desired_pose"][:] = start
        for _ in range(2000):
            twist = np.array([-0.05, 0.02, -0.05, 0.05, 0, 0])
            rig.chain.law.input["desired_pose"][:3] += rig.dt * twist[:3]
            rig.chain.law.input["desired_twist"][:] = twist
            rig.step()
            assert np.isfinite(rig.q).all()
        moved = rig.chain.law.input["pose"][:3] - start[:3]
        assert np.linalg.norm(moved - 4 * np.array([-0.05, 0.02, -0.05])) < 0.1


@pytest.mark.slow
def test_at_joint_limits_it_stays_bounded_and_comes_back() -> None:
    """The guard holds a joint at its limit; the others and the base go on, the leash keeps the reference near."""
    rig = KairosRig(admittance={"dead_band": (0, 0)})
    low, high = UR16E.home - 0.3, UR16E.home + 0.3
    command = Command(name="velocity", shape=(6,), unit="rad/s", kind=Kind.VELOCITY)
    guard = VelocityGuard(
        "guard.arm",
        command,
        Limits(lower=low, upper=high, velocity=UR16E.dq_max, acceleration=np.full(6, 10.0)),
        rig.dt,
    )
    guard.bind(np.zeros(6), rig.q)
    guard.reset(rig.q)
    rig.chain.press("A")
    for k in range(6000):
        rig.chain.wrench[:3] = [0, 0, 30] if k < 3000 else [0, 0, -30]
        chain = rig.chain
        chain.update(rig.q, rig.qd, rig.base, rig.twist, rig.dt)
        chain.press()
        guard.step(chain.law.output["velocity"], None, rig.dt)
        where = rig.q
        rig.move(guard.applied, chain.law.output["base_twist"])
        where[:] = rig.q  # the guard looks at this array
        rig.q = where
        assert (low - 1e-3 <= rig.q).all()
        assert (rig.q <= high + 1e-3).all()
        assert np.abs(chain.law.output["velocity"]).max() <= UR16E.dq_max.max()
        if k == 2999:
            stretched = chain.admittance.output["pose"][:3] - chain.tool.output["pose"][:3]
            held = rig.q.copy()
            assert np.linalg.norm(stretched) < 0.1
    assert (np.minimum(held - low, high - held) < 0.02).any()
    assert (np.minimum(rig.q - low, high - rig.q) > 0).all()


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 2.5])
def test_the_bases_command_is_in_its_own_frame(yaw: float) -> None:
    here = np.array([1.0, -2.0, yaw])
    commands = []
    for base in (np.zeros(3), here):
        controller = law(base=base)
        controller.input["modes"][3] = 1
        controller.reset()
        turn = Rotation.from_euler("z", base[2]).as_matrix()
        controller.input["desired_twist"][:] = np.concatenate([turn @ [0.2, -0.1, 0], turn @ [0, 0, 0.1]])
        controller.input["desired_pose"][:] = controller.input["pose"]
        controller.update(2e-3)
        commands.append(np.concatenate([controller.output["base_twist"], controller.output["velocity"]]))
    np.testing.assert_allclose(commands[1], commands[0], atol=1e-9)


@pytest.mark.slow
def test_manipulation_spares_the_base_and_locomotion_the_arm() -> None:
    moved = []
    for mode in ("", "P"):
        rig = KairosRig()
        rig.chain.press(mode)
        rig.step()
        rig.chain.press()
        rig.step(300)
        q = rig.q.copy()
        rig.chain.press("A")
        for _ in range(1500):
            rig.chain.wrench[:3] = [0, 8, 0]
            rig.step()
            rig.chain.press()
        moved.append((np.linalg.norm(rig.base[:2]), np.abs(rig.q - q).max()))
    assert moved[0][0] < 0.2 * moved[1][0]
    assert moved[1][1] < 0.7 * moved[0][1]


@pytest.mark.slow
def test_buttons_at_any_instant_make_no_step() -> None:
    rng = np.random.default_rng(12)
    rig = KairosRig()
    rig.chain.press("A")
    rig.step()
    arm, base = [], []
    for k in range(9000):
        if k % 25 == 0:
            rig.chain.press(*[name for name in "AMGP" if rng.random() < 0.15])
        if k % 60 == 0:
            rig.chain.wrench[:] = rng.normal(0, [6, 6, 6, 0.3, 0.3, 0.3])
        rig.step()
        arm.append(rig.chain.law.output["velocity"].copy())
        base.append(rig.chain.law.output["base_twist"].copy())
    assert sum(rig.chain.keys.metrics()["presses"].values()) > 60  # type: ignore[attr-defined]
    assert np.abs(np.diff(arm, axis=0)).max() / rig.dt < 20.0  # rad/s^2; the hand's own 30 N / 6 kg among it
    assert np.abs(np.diff(base, axis=0)).max() / rig.dt < 5.0


def test_a_switch_alone_makes_no_step_even_back_and_forth() -> None:
    controller = law()
    controller.input["desired_twist"][:] = [0.1, 0.05, -0.1, 0.1, 0, 0.1]
    rng, before, q = np.random.default_rng(3), None, UR16E.home.copy()
    for k in range(3000):
        if rng.random() < 0.01:
            controller.input["modes"][3] = 1 - controller.input["modes"][3]
        q = q + 2e-4 * np.sin(k / 300 + np.arange(6))  # it is pulled about meanwhile
        place(controller, q)
        controller.input["desired_pose"][:] = controller.input["pose"]
        controller.update(2e-3)
        now = world(controller)
        if before is not None:
            assert np.abs(now - before).max() / 2e-3 < 2.0
        before = now


def test_joints_change_no_faster_than_told_even_where_the_arm_is_stretched() -> None:
    """Also against what the guard let through, and with the direction of the change kept."""
    for most in (None, 15.0):
        controller = bound(KairosClik("k", KairosClikConfig(acceleration=most, speed=None)))
        rng = np.random.default_rng(5)
        controller.input["jacobian"][:] = rng.normal(0, 0.3, (6, 9))
        controller.input["pose"][3] = controller.input["desired_pose"][3] = 1.0
        controller.reset()
        controller.input["desired_twist"][:] = [0.3, -0.2, 0.1, 0.0, 0.1, 0.0]
        controller.update(2e-3)
        velocity = controller.output["velocity"].copy()
        if most is None:
            free = velocity
    assert np.abs(free).max() > 0.03
    assert np.abs(velocity).max() == pytest.approx(0.03)
    np.testing.assert_allclose(velocity / np.linalg.norm(velocity), free / np.linalg.norm(free), atol=1e-9)


def test_inputs_depend_on_the_option() -> None:
    names = {s.name for s in KairosClik("k", KairosClikConfig()).inputs}
    more = {s.name for s in KairosClik("k", KairosClikConfig(force_feedback={})).inputs}
    less = {s.name for s in KairosClik("k", KairosClikConfig(force_feedback={"hand": False})).inputs}
    assert more - names == {"flange_wrench", "hand"}
    assert less - names == {"flange_wrench"}
