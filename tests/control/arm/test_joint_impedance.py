"""Joint impedance: gravity of a tilted base, passivity against a wall and a person, changes without a jump."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers.joint_impedance import ROBOT, K, Q, law
from pydantic import ValidationError

from srl.control.arm.joint_impedance import JointImpedance
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import add_chain
from srl.testing import ControllerConformance


class TestConformance(ControllerConformance):
    inputs = {"q": Q, "wanted": Q + 0.3, "qd": np.zeros(4)}  # noqa: RUF012
    start = {"torque": pin.computeGeneralizedGravity(*(m := pinocchio_model(ROBOT), m.createData()), Q)}  # noqa: RUF012

    def law(self) -> JointImpedance:
        return law()


class Body:
    """The arm under torques, against a plane that gives way: a wall or a person. Own integration, 0.1 ms."""

    def __init__(self, stiffness: float, damping: float, q: np.ndarray, qd: np.ndarray) -> None:
        self.model = pinocchio_model(ROBOT)
        self.data = self.model.createData()
        self.flange = self.model.getFrameId(FLANGE)
        self.k, self.d, self.q, self.qd = stiffness, damping, q.copy(), qd.copy()
        pin.framesForwardKinematics(self.model, self.data, q)
        self.plane = self.data.oMf[self.flange].translation[2] - 0.03  # below the flange; it pushes up
        self.given = 0.0  # J that the plane's damper took

    def depth(self) -> float:
        pin.framesForwardKinematics(self.model, self.data, self.q)
        return max(self.plane - float(self.data.oMf[self.flange].translation[2]), 0.0)

    def step(self, torque: np.ndarray, dt: float = 1e-4) -> None:
        deep = self.depth()
        J = pin.computeFrameJacobian(self.model, self.data, self.q, self.flange, pin.LOCAL_WORLD_ALIGNED)[2]
        push = self.k * deep - self.d * float(J @ self.qd) * (deep > 0.0)
        qdd = pin.aba(self.model, self.data, self.q, self.qd, torque + J * max(push, 0.0))
        self.qd += dt * qdd
        self.q += dt * self.qd

    def energy(self, made: JointImpedance) -> float:
        """J, of motion, the law's springs and the plane; gravity is compensated."""
        M = pin.crba(self.model, self.data, self.q)
        M = np.triu(M) + np.triu(M, 1).T
        away = made.output["desired"] - self.q
        spring = 0.5 * float(np.array(list(K.values())) @ away**2)
        return 0.5 * float(self.qd @ M @ self.qd) + spring + 0.5 * self.k * self.depth() ** 2


@pytest.mark.parametrize(("stiffness", "damping"), [(40_000.0, 0.0), (400.0, 5.0)], ids=["stiff wall", "soft person"])
def test_it_gives_no_energy_to_what_it_hits(stiffness: float, damping: float) -> None:
    made = law(follow=False, most=100.0)
    made.reset()
    body = Body(stiffness, damping, Q, np.array([0.0, 1.5, 1.5, 0.0]))
    energies, deepest = [], 0.0
    for i in range(12_000):
        if i % 10 == 0:  # the law each ms
            made.input["q"][:], made.input["qd"][:] = body.q, body.qd
            made.update(1e-3)
            energies.append(body.energy(made))
        body.step(made.output["torque"])
        deepest = max(deepest, body.depth())
    assert deepest > 1e-3  # it did hit
    assert np.diff(energies).max() < 1e-3 * energies[0]
    assert energies[-1] < 0.01 * energies[0]
    assert np.abs(body.qd).max() < 0.01


def test_stiffening_a_stretched_spring_keeps_the_torque_and_the_energy() -> None:
    made = law(follow=False, most=100.0)
    made.reset()
    made.param["stiffness"][()] = 0.5
    for _ in range(100):
        made.update(0.01)
    made.input["q"][:] = Q + 0.1
    made.update(0.01)
    before = made.output["torque"] - made.output["gravity"]
    away = made.output["desired"] - made.input["q"]
    stored = 0.5 * 0.5 * np.array(list(K.values())) @ away**2
    made.param["stiffness"][()] = 1.5
    for _ in range(200):
        made.update(0.01)
    after = made.output["torque"] - made.output["gravity"]
    away = made.output["desired"] - made.input["q"]
    assert after == pytest.approx(before, abs=1e-9)
    assert 0.5 * 1.5 * np.array(list(K.values())) @ away**2 < stored


def test_a_parameter_changes_the_torque_gradually() -> None:
    made = law(follow=False)
    made.reset()
    made.input["q"][:], made.input["qd"][:] = Q + 0.05, 0.5
    made.update(0.001)
    last = made.output["torque"].copy()
    made.param["stiffness"][()], made.param["damping"][()] = 0.0, 1.5
    for _ in range(2000):
        made.update(0.001)
        assert np.abs(made.output["torque"] - last).max() < 0.01
        last = made.output["torque"].copy()
    assert made.output["torque"] == pytest.approx(made.output["gravity"])


def test_what_is_pushed_away_takes_the_desired_joints_along() -> None:
    made = law(most={"yaw": 2.0, "shoulder": 2.0, "elbow": 2.0, "wrist": 1.0})
    made.reset()
    for _ in range(500):
        made.input["q"][0] += 0.002  # a hand, 1 rad
        made.update(0.01)
    assert made.output["torque"][0] - made.output["gravity"][0] == pytest.approx(-2.0)
    made.input["wanted"][0] = made.input["q"][0]
    made.update(0.01)
    assert abs(made.output["desired"][0] - made.input["q"][0]) < 2.0 / 20.0 + 1e-9  # nothing is wound up
    assert made.metrics()["back_driven"] > 0.5


def test_the_desired_joints_go_at_their_speed_and_not_beyond_the_limits() -> None:
    made = law(speed=0.5)
    made.reset()
    made.input["wanted"][:] = 9.0
    for _ in range(100):
        before = made.output["desired"].copy()
        made.update(0.01)
        made.input["q"][:] = made.output["desired"]
        assert (np.abs(made.output["desired"] - before) <= 0.005 + 1e-12).all()
    for _ in range(1000):
        made.update(0.01)
        made.input["q"][:] = made.output["desired"]
    assert made.output["desired"] == pytest.approx(ROBOT.q_upper)


@pytest.mark.parametrize(("lead", "lag"), [(0.0, 1.0), (1.0, 0.0)])
def test_a_desired_motion_that_is_led_is_not_damped(lead: float, lag: float) -> None:
    """The arm moves as it is wanted to: what the spring still has to give is lag times D v."""
    made = law(lead=lead)
    made.reset()
    v = np.array([0.2, -0.1, 0.15, 0.1])
    made.input["qd"][:] = v
    for _ in range(200):
        made.input["q"] += 0.002 * v
        made.input["wanted"][:] = made.input["q"]
        made.update(0.002)
    M = pin.crba(model := pinocchio_model(ROBOT), model.createData(), made.input["q"]).diagonal()
    drag = 1.4 * np.sqrt(np.array(list(K.values())) * M) * v
    assert made.output["torque"] - made.output["gravity"] == pytest.approx(-lag * drag, abs=2e-3)


def test_who_holds_a_joint_that_is_led_gets_no_more_than_the_greatest_torque() -> None:
    made = law(lead=1.0, most=2.0, speed=5.0)
    made.reset()
    for _ in range(300):
        made.input["wanted"][:] = Q + 1.0
        made.update(0.002)
        assert np.abs(made.output["torque"] - made.output["gravity"]).max() <= 2.0 + 1e-12
    assert made.output["torque"] - made.output["gravity"] == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["q", "qd", "wanted"])
def test_a_number_that_is_none_leaves_nothing_behind(name: str) -> None:
    clean, made = law(), law()
    for each in (clean, made):
        each.reset()
        each.update(0.01)
    kept = made.input[name].copy()
    made.input[name][:] = np.nan
    made.update(0.01)
    assert np.isfinite(made.output["torque"]).all() == (name == "wanted")
    made.input[name][:] = kept
    made.update(0.01)
    clean.update(0.01)
    assert made.output["torque"] == pytest.approx(clean.output["torque"], abs=1e-12)


def test_a_reset_without_measured_joints_waits_and_begins_where_the_limb_is() -> None:
    made = law(timeout=0.2)
    made.input["q"][:] = np.nan
    made.reset()
    for _ in range(20):
        assert not np.isfinite(made.output["torque"]).any()  # refused: the guard damps
        assert not made.lost
        made.update(0.01)
    made.update(0.01)
    assert made.lost
    made.input["q"][:] = Q - 0.4
    made.update(0.01)
    assert not made.lost
    assert made.output["desired"] == pytest.approx(Q - 0.4, abs=0.01)
    assert np.abs(made.output["torque"] - made.output["gravity"]).max() < 0.2


def test_one_wrong_sample_moves_nothing_and_one_that_lasts_begins_anew() -> None:
    """The second joint, say, reads a radian off: a bit that flipped on the wire."""
    clean, made = law(follow=False), law(follow=False)
    for each in (clean, made):
        each.reset()
        each.update(0.002)
    made.input["q"][1] += 1.0
    made.update(0.002)
    assert made.output["torque"] == pytest.approx(clean.output["torque"], abs=1e-9)
    made.input["q"][1] -= 1.0
    made.update(0.002)
    clean.update(0.002)
    assert made.output["torque"] == pytest.approx(clean.output["torque"], abs=1e-9)
    assert made.output["desired"] == pytest.approx(clean.output["desired"], abs=1e-9)
    assert made.metrics()["rejected"] == pytest.approx(1 / 3)
    made.input["q"][1] += 1.0
    spring = []
    for _ in range(200):
        made.update(0.002)
        spring.append(np.abs(made.output["torque"] - made.output["gravity"]).max())
    assert np.isnan(spring).any()  # the guard damps meanwhile
    assert np.nanmax(spring) < 1e-9
    assert made.output["desired"] == pytest.approx(made.input["q"])


def test_the_damping_is_that_of_each_joint_alone() -> None:
    """2 ratio sqrt(K M_ii), with the inertia of another engine, of the arm with a load and rotors."""
    rotors = {"yaw": 0.02, "shoulder": 0.03, "elbow": 0.01, "wrist": 0.004}
    made = law(follow=False, damping_ratio=0.6, rotor_inertia=rotors)
    root, mjcf = Element("mujoco"), Mjcf()
    add_chain(mjcf, mjcf.worldbody, ROBOT, "arm", {name: {} for name in ROBOT.labels}, {})
    add(root, "compiler", angle="radian", autolimits=True)
    root.append(mjcf.worldbody)
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    data.qpos[:] = Q
    M = np.zeros((4, 4))
    for i in range(4):  # column by column, from inverse dynamics
        for sign in (1.0, -1.0):
            data.qacc[:] = sign * np.eye(4)[i]
            mujoco.mj_inverse(model, data)
            M[:, i] += 0.5 * sign * data.qfrc_inverse
    made.reset()
    still = made.output["torque"].copy()
    for i, name in enumerate(ROBOT.labels):
        made.input["qd"][:] = np.eye(4)[i]
        made.update(0.001)
        damped = (still - made.output["torque"])[i]
        inertia = M[i, i] - model.dof_armature[i] + rotors[name]
        assert damped == pytest.approx(2 * 0.6 * np.sqrt(K[name] * inertia), rel=1e-6)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"stiffness": {"yaw": 1.0}}, "stiffness: "),
        ({"stiffness": {**K, "knee": 1.0}}, "stiffness: .*knee"),
        ({"speed": {"yaw": 1.0}}, "speed: "),
        ({"stiffness": -1.0}, "stiffness"),
        ({"up": [0.0, 0.0, 0.0]}, "up\n.*no direction"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        law(**options)
