"""The model that a simulated Franka robot gives away: the same arm in C, in URDF and in the runtime's description."""

from __future__ import annotations

import ctypes
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pinocchio as pin
import pytest
from helpers.wait import until

from srl.runtime.models.robots import FR3, PANDA
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.sim.devices.panda.motion import limits_of
from srl.sim.devices.panda.twin_library import Build
from srl.sim.devices.panda.twin_urdf import urdf

MASS, COM, INERTIA = 1.5, np.array([0.1, 0.02, 0.05]), np.array([[0.1, 0.01, 0], [0.01, 0.2, 0], [0, 0, 0.3]])
Call = Callable[..., Any]


@pytest.fixture(scope="module")
def call(tmp_path_factory: pytest.TempPathFactory) -> Call:
    """Calls one of the library's functions: name, size of its result, arguments."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    build = Build()
    until(build.poll, what="gcc", timeout=60.0, pause=0.01)
    assert build.shared_object is not None
    file = Path(tmp_path_factory.mktemp("model")) / "model.so"
    file.write_bytes(build.shared_object)
    library = ctypes.CDLL(str(file))

    def call(name: str, size: int, *arguments: Any) -> Any:
        out = np.zeros(size)
        kept = [a if isinstance(a, float) else np.asfortranarray(a, dtype=float) for a in arguments]
        given = [
            ctypes.c_double(a) if isinstance(a, float) else ctypes.c_void_p(np.asarray(a).ctypes.data) for a in kept
        ]
        getattr(library, name)(*given, ctypes.c_void_p(out.ctypes.data))
        return out

    return call


def configurations() -> list[Any]:
    rng = np.random.default_rng(3)
    return [(rng.uniform(PANDA.q_lower, PANDA.q_upper), rng.normal(size=7)) for _ in range(5)]


def loaded() -> Any:
    model = pinocchio_model(PANDA)
    frame = model.frames[model.getFrameId(FLANGE)]
    model.appendBodyToJoint(frame.parentJoint, pin.Inertia(MASS, COM, INERTIA), frame.placement)
    return model


@pytest.mark.parametrize(("q", "dq"), configurations())
def test_dynamics_in_c_are_pinocchios(call: Call, q: Any, dq: Any) -> None:
    for model, load in ((pinocchio_model(PANDA), (np.zeros(9), 0.0, np.zeros(3))), (loaded(), (INERTIA, MASS, COM))):
        data = model.createData()
        M = pin.crba(model, data, q, pin.Convention.WORLD)
        np.testing.assert_allclose(call("M_NE", 49, q, *load).reshape(7, 7), M, atol=1e-12)
        g = pin.computeGeneralizedGravity(model, data, q)
        np.testing.assert_allclose(call("g_NE", 7, q, np.array([0, 0, -9.81]), *load[1:]), g, atol=1e-12)
        bias = pin.nonLinearEffects(model, data, q, dq)
        np.testing.assert_allclose(call("c_NE", 7, q, dq, *load), bias - g, atol=1e-12)


@pytest.mark.parametrize(("q", "dq"), configurations())
def test_kinematics_in_c_are_pinocchios(call: Call, q: Any, dq: Any) -> None:
    model = pinocchio_model(PANDA)
    tool = pin.SE3(pin.Quaternion(0.5, 0.5, -0.5, 0.5), np.array([0.01, 0.02, 0.1]))
    flange = model.frames[model.getFrameId(FLANGE)].placement
    places = [(i, pin.SE3.Identity()) for i in range(1, 8)] + [(7, flange), (7, flange * tool)]
    frames = [model.addFrame(pin.Frame(f"f{n}", joint, 0, at, pin.OP_FRAME)) for n, (joint, at) in enumerate(places)]
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    for number, frame in enumerate(frames, 1):
        extra = [np.array(tool.homogeneous)] if number == 9 else []
        T = call(f"O_T_J{number}", 16, q, *extra).reshape(4, 4).T
        np.testing.assert_allclose(T, data.oMf[frame].homogeneous, atol=1e-12)
        arguments = [] if number == 1 else [q, *extra]
        for function, axes in (("O_J_J", pin.LOCAL_WORLD_ALIGNED), ("Ji_J_J", pin.LOCAL)):
            J = pin.getFrameJacobian(model, data, frame, axes)
            np.testing.assert_allclose(call(f"{function}{number}", 42, *arguments).reshape(7, 6).T, J, atol=1e-12)


def test_without_a_compiler_there_is_no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("srl.sim.devices.panda.twin_library._done", {})
    monkeypatch.setattr("shutil.which", lambda _: None)
    build = Build()
    assert build.poll()
    assert build.shared_object is None


@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_the_urdf_is_the_same_arm(robot: str) -> None:
    model, own = pin.buildModelFromXML(urdf(robot)), pinocchio_model(FR3 if robot == "fr3" else PANDA)
    data, own_data = model.createData(), own.createData()
    for q, _ in configurations():
        pin.framesForwardKinematics(model, data, q)
        pin.framesForwardKinematics(own, own_data, q)
        flange = own_data.oMf[own.getFrameId(FLANGE)].homogeneous
        np.testing.assert_allclose(data.oMf[model.getFrameId("link8")].homogeneous, flange, atol=1e-12)
        M = pin.crba(model, data, q, pin.Convention.WORLD)
        np.testing.assert_allclose(M, pin.crba(own, own_data, q, pin.Convention.WORLD), atol=1e-12)
    limits = limits_of(robot)
    np.testing.assert_array_equal(model.lowerPositionLimit, limits.lower)
    np.testing.assert_array_equal(model.upperPositionLimit, limits.upper)
    np.testing.assert_array_equal(model.velocityLimit, limits.velocity)
    np.testing.assert_array_equal(model.effortLimit, limits.effort)


def test_the_fr3s_urdf_has_its_velocity_limits_by_position() -> None:
    joints = [joint for joint in fromstring(urdf("fr3")).iter("joint") if joint.get("type") == "revolute"]
    assert [joint.get("name") for joint in joints] == [f"joint{i}" for i in range(1, 8)]
    offsets = [float(joint.find("position_based_velocity_limits").get("velocity_offset")) for joint in joints]  # type: ignore[union-attr, arg-type]
    assert offsets == [0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628]
