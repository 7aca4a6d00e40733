"""Joint impedance and where up is: gravity of a tilted base, a base that no wearer can tilt so, what a stop weighs."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from helpers.joint_impedance import ROBOT, Q, law, weight
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.rotation import conjugate, exp, matrix, product
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import add_chain

TURNED = exp(0.5, -0.3, 0.9)  # how the sensor sits on the base


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-1.2, 1.2)] * 3), st.tuples(*[st.floats(-1.4, 1.4)] * 4))
def test_it_holds_the_weight_of_an_arm_whose_base_is_tilted(tilt: Any, q: Any) -> None:
    base = exp(*tilt)  # of the base in the world; the sensor is turned on it
    made = law(q, {"mount": (0.1, 0.0, 0.0, *TURNED)}, upright="imu", tilt_limit=3.15)
    made.input["orientation"][:] = product(base, TURNED)
    made.reset()
    root = Element("mujoco")  # the oracle: the same arm in MuJoCo, on a body that is turned
    mjcf = Mjcf()
    add_chain(mjcf, mjcf.worldbody, ROBOT, "arm", {name: {} for name in ROBOT.labels}, {"quat": base})
    add(root, "compiler", angle="radian", autolimits=True)
    root.append(mjcf.worldbody)
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    assert made.output["torque"] == pytest.approx(data.qfrc_bias, abs=1e-8)
    assert made.output["gravity"] == pytest.approx(data.qfrc_bias, abs=1e-8)


@pytest.mark.parametrize("upright", ["imu", "frames"])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("degrees", [-90, 90, 180])
def test_a_base_that_no_wearer_can_tilt_so_is_refused_at_the_reset(upright: str, axis: int, degrees: float) -> None:
    """A sensor mounted upside down would turn the weight round: the limb would be pushed down, or up into the face."""
    turned = exp(*np.deg2rad(degrees) * np.eye(3)[axis])
    place = "base" if upright == "frames" else "mount"  # the sensor's frame is wrong, or that of the cameras
    made = law(upright=upright, transforms={place: (0.0, 0.0, 0.0, *turned)})
    made.reset()
    assert made.lost
    for word in (
        "orientation" if upright == "imu" else "frames",
        f"{abs(degrees)} degrees",
        "60 at most",
        "tilt_limit",
    ):
        assert word in made.why
    for _ in range(100):  # in the stop the weight is held as of a wearer who stands
        made.update_gravity(0.01)
        assert made.output["gravity"] == pytest.approx(weight((0, 0, 1)), abs=1e-9)


@given(st.floats(0.0, 0.99), st.floats(-np.pi, np.pi))
def test_a_wearer_who_leans_is_not(share: float, way: float) -> None:
    lean = exp(np.deg2rad(60) * share * np.cos(way), np.deg2rad(60) * share * np.sin(way), 0.0)
    made = law(upright="imu")
    made.input["orientation"][:] = lean
    made.reset()
    assert (made.lost, made.why) == (False, "")
    assert made.output["gravity"] == pytest.approx(weight(np.array(matrix(lean))[2]), abs=1e-9)


@given(st.floats(1.1, np.pi), st.floats(-np.pi, np.pi))
def test_a_base_that_goes_too_far_is_followed_until_it_lies_and_stops_the_limb(tilt: float, way: float) -> None:
    """A wearer who lies down, or a sensor that has come off: nobody knows which."""
    made = law(upright="imu", timeout=0.3, smooth=0.0)
    made.reset()
    made.input["orientation"][:] = exp(tilt * np.cos(way), tilt * np.sin(way), 0.0)
    for _ in range(29):
        made.update(0.01)
        assert not made.lost
    most = min(tilt, np.pi / 2)
    cut = np.array(matrix(exp(most * np.cos(way), most * np.sin(way), 0.0)))[2]
    if tilt < 3.14:
        assert made.output["gravity"] == pytest.approx(weight(cut), abs=1e-6)
    made.update(0.02)
    assert made.lost
    assert f"{np.rad2deg(tilt):.0f} degrees" in made.why
    held = made.output["gravity"].copy()
    made.reset()
    assert made.lost
    made.update_gravity(0.01)
    assert made.output["gravity"] == pytest.approx(held, abs=1e-6)
    made.input["orientation"][:] = (1.0, 0.0, 0.0, 0.0)
    made.reset()
    assert (made.lost, made.why) == (False, "")


@pytest.mark.parametrize("upright", ["imu", "base"])
def test_an_arm_may_be_worn_on_its_side(upright: str) -> None:
    made = law(upright=upright, up=[0.0, -2.0, 0.0])
    if upright == "imu":
        made.input["orientation"][:] = exp(-np.pi / 2, 0.0, 0.0)
    made.reset()
    assert not made.lost
    assert made.output["gravity"] == pytest.approx(weight((0, -1, 0)), abs=1e-9)


def test_frames_that_are_measured_say_where_up_is_too() -> None:
    tilt = exp(0.4, 0.2, 1.0)
    made = law(upright="frames", transforms={"base": (0.0, 0.0, 1.0, *tilt)})
    made.reset()
    model = pinocchio_model(ROBOT, gravity=tuple(-9.81 * np.array(matrix(conjugate(tilt)))[:, 2]))
    expected = pin.computeGeneralizedGravity(model, model.createData(), Q)
    assert made.output["torque"] == pytest.approx(expected, abs=1e-9)


def test_lost_up_is_held_and_then_stops_the_limb() -> None:
    made = law(upright="imu", timeout=0.3)
    made.input["orientation"][:] = exp(0.3, 0.0, 0.0)
    made.reset()
    held = made.output["gravity"].copy()
    made.input["orientation"][:] = np.nan
    for _ in range(29):
        made.update(0.01)
        assert not made.lost
        assert made.output["gravity"] == pytest.approx(held, abs=1e-12)
    made.update(0.02)
    assert made.lost
    made.reset()
    assert made.lost  # nobody has said where up is since
    made.input["orientation"][:] = exp(0.3, 0.0, 0.0)
    made.update(0.01)
    assert not made.lost


def test_in_a_stop_it_weighs_on_as_the_limb_and_its_base_are_and_nothing_else() -> None:
    """A limb that is led by hand while its wearer leans, then a sensor that isn't there any more."""
    made = law(upright="imu", timeout=0.3)
    made.reset()
    made.update(0.002)
    torque, desired = made.output["torque"].copy(), made.output["desired"].copy()
    for k in range(500):
        made.input["q"][:] = Q + np.array([0.2, -0.9, 0.5, 0.3]) * k / 499
        made.input["orientation"][:] = exp(0.1 * k / 499, -0.7 * k / 499, 0.0)
        made.update_gravity(0.002)
    for _ in range(100):  # the low-pass on where up is
        made.update_gravity(0.002)
    tilt = exp(0.1, -0.7, 0.0)
    model = pinocchio_model(ROBOT, gravity=tuple(-9.81 * np.array(matrix(conjugate(tilt)))[:, 2]))
    expected = pin.computeGeneralizedGravity(model, model.createData(), made.input["q"])
    assert made.output["gravity"] == pytest.approx(expected, abs=1e-3)
    assert made.output["torque"] == pytest.approx(torque, abs=0.0)
    assert made.output["desired"] == pytest.approx(desired, abs=0.0)
    held = made.output["gravity"].copy()
    made.input["orientation"][:] = np.nan
    made.input["q"][:] = np.nan
    for _ in range(500):
        made.update_gravity(0.002)
    assert made.output["gravity"] == pytest.approx(held, abs=0.0)
