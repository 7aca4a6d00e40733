"""The exact step of eq. (1), against scipy's matrix exponential and a fine integration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from srl.control.cobot.admittance import Admittance, AdmittanceConfig
from srl.control.cobot.virtual_mass import VirtualMass

START = ((0.1, -0.2, 0.3), (1.0, 0.0, 0.0, 0.0))


def exact(h: float, m: float, d: float, f: float, x: float, v: float) -> tuple[float, float]:
    """Position and speed after h by the matrix exponential of (x, v, f)."""
    A = np.array([[0, 1, 0], [0, -d / m, 1 / m], [0, 0, 0]])
    x, v, _ = expm(h * A) @ (x, v, f)
    return float(x), float(v)


@settings(max_examples=150, deadline=None)
@given(
    st.floats(1e-3, 1.0), st.floats(1e-3, 100.0), st.floats(0.0, 500.0), st.floats(-100, 100), st.floats(-2, 2)
)  # fmt: skip
@example(1e-3, 6.0, 40.0, 10.0, 0.0)
@example(1.0, 0.05, 40.0, 10.0, 1.0)  # a light mass: D h/M = 800
@example(1.0, 6.0, 0.0, 10.0, 1.0)  # no damping
def test_a_step_is_the_matrix_exponential(h: float, m: float, d: float, f: float, v: float) -> None:
    virtual = VirtualMass()
    virtual.reset(*START)
    virtual.velocity = [0.0, v, 0.0, 0.0, 0.0, 0.0]
    virtual.step(h, [m] * 6, [d] * 6, [0.0, f, 0.0, 0.0, 0.0, 0.0])
    x, speed = exact(h, m, d, f, START[0][1], v)
    assert virtual.velocity[1] == pytest.approx(speed, rel=1e-9, abs=1e-12)
    assert virtual.position[1] == pytest.approx(x, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("h", [1e-3, 1e-2, 0.1, 1.0])
def test_the_law_s_step_is_exact_at_any_cycle_time(h: float) -> None:
    """A push that changes from cycle to cycle; the leash is slack, the tank full."""
    controller = bound(Admittance("admittance", AdmittanceConfig(dead_band=(0, 0), leash=None)))
    controller.input["pose"][3], controller.input["modes"][:2] = 1.0, 1.0
    controller.reset()
    rng = np.random.default_rng(1)
    x, v, angle, w = 0.0, 0.0, 0.0, 0.0
    for f, t in rng.normal(0, (10, 0.5), (20, 2)):
        controller.input["wrench"][:] = [f, 0, 0, t, 0, 0]
        controller.input["twist"][0] = 0.05 * np.sign(f)  # a robot that follows the push
        controller.update(h)
        x, v = exact(h, 6.0, 40.0, f, x, v)
        angle, w = exact(h, 1.0, 1.8, t, angle, w)
        controller.input["pose"][:] = controller.output["pose"]
        controller.input["pose"][3:] = [1, 0, 0, 0]  # the wrench keeps its axes
    twist, pose = controller.output["twist"], controller.output["pose"]
    np.testing.assert_allclose([twist[0], twist[3], pose[0]], [v, w, x], rtol=1e-9, atol=1e-12)
    turned = Rotation.from_quat(pose[[4, 5, 6, 3]]) * Rotation.from_rotvec([-angle, 0, 0])
    assert turned.magnitude() < 1e-9


@pytest.mark.parametrize(("h", "off"), [(1e-3, 1e-8), (1e-2, 1e-6)])
def test_the_orientation_is_off_by_the_third_power_of_the_step_where_the_axis_changes(h: float, off: float) -> None:
    def after(step: float, seconds: float = 1.0) -> Rotation:
        virtual = VirtualMass()
        virtual.velocity = [0.0, 0.0, 0.0, 1.0, 0.0, 0.5]
        for _ in range(round(seconds / step)):
            virtual.step(step, [1.0] * 6, [1.8] * 6, [0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
        w, x, y, z = virtual.orientation
        return Rotation.from_quat([x, y, z, w])

    assert (after(h) * after(2e-4).inv()).magnitude() < 10 * off  # a second, of steps that are off by h^3/12 |w x w'|


def test_a_taut_leash_is_stable_at_any_cycle_time() -> None:
    controller = bound(Admittance("admittance", AdmittanceConfig(mass=(1.0,) * 3 + (0.1,) * 3)))
    controller.input["pose"][3], controller.input["modes"][:2] = 1.0, 1.0
    controller.reset()
    controller.input["wrench"][:] = [20, 0, 0, 0, 0, 1.5]
    for _ in range(20):
        controller.update(1.0)
    assert np.abs(controller.output["twist"]).max() < 1e-6
    assert controller.output["pose"][0] == pytest.approx(0.03 + 19.7 / 1000, abs=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(0.2, 5.0), st.floats(0.3, 5.0)), min_size=1, max_size=8), st.integers(0, 5))
def test_mass_and_damping_change_in_motion_without_a_step_and_without_new_energy(changes: Any, axis: int) -> None:
    controller = bound(Admittance("admittance", AdmittanceConfig(tank=None)))
    controller.input["pose"][3], controller.input["modes"][:2] = 1.0, 1.0
    controller.reset()
    controller._virtual.velocity[axis] = v = 0.5
    energy, mass = np.inf, controller._M[axis]
    for scale, damping in changes:
        controller.param["scale"][()], controller.param["damping"][()] = scale, damping
        for _ in range(60):
            controller.update(2e-3)
            controller.input["pose"][:] = controller.output["pose"]
            now, v = v, controller.output["twist"][axis]
            assert 0 <= v <= now
            assert abs(controller._M[axis] - mass) <= 2e-3 * 2.0 * 6.0 * (1 + 1e-9)
            mass = controller._M[axis]
            kinetic = 0.5 * mass * v * v
            assert kinetic <= energy * (1 + 1e-12)
            energy = kinetic


def test_the_leash_does_not_jump_at_half_a_turn() -> None:
    """A weak leash whose robot stays while a hand turns the desired orientation by more than half a turn, and back."""
    leash = {"angle": 2.9, "rotational_stiffness": 0.5}
    controller = bound(Admittance("admittance", AdmittanceConfig(leash=leash, tank=None)))
    controller.input["pose"][3], controller.input["modes"][:2] = 1.0, 1.0
    controller.reset()
    twists, farthest = [0.0], 0.0
    for k in range(8000):
        controller.input["wrench"][5] = 1.0 if k < 3500 else 0.0
        controller.update(5e-3)
        twists.append(controller.output["twist"][5].item())
        farthest = max(farthest, abs(controller._ahead[2]))
    assert farthest > 4.5  # 2.9 and 0.97 N m over 0.5 N m/rad
    assert np.abs(np.diff(twists)).max() < 0.01  # what 1 N m and the leash make in a cycle of 5 ms
    assert 0 < controller._ahead[2] < 3.0  # back the way it came
