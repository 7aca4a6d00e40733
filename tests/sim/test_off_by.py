"""A part that stands elsewhere than the profile says: only the world knows, and the tip is off by what follows."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from srl.runtime.contracts.signals import Array
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.connections import transforms
from srl.sim.world.cell import Cell


def run(name: str, *overrides: str, seconds: float = 0.5) -> Lockstep:
    lockstep = Lockstep(wiring.build(*profile.load(name, overrides), []), lambda text: None)
    for _ in range(round(seconds * 1e9 / lockstep.period)):
        lockstep.step()
    world = lockstep.graph.world
    assert isinstance(world, Cell)
    mujoco.mj_kinematics(world.model, world.data)
    return lockstep


def tool_error(name: str, *overrides: str) -> Array:
    """(3,) m: where the control point is in the world, from where the law believes it to be."""
    lockstep = run(name, *overrides)
    data: Any = lockstep.graph.world.data  # type: ignore[union-attr]
    turn = Rotation.from_quat(data.body("arm/flange").xquat, scalar_first=True)
    flange = RigidTransform.from_components(data.body("arm/flange").xpos, turn)
    found: Array = flange.apply([0.0, 0.0, 0.1]) - lockstep.graph.row.views["tool.pose"][:3]
    return found


def finger_error(*overrides: str) -> Array:
    """(3,) m: the finger's tip in the hand, from where the law would have it for the servos' angles."""
    lockstep = run("sixth-finger", *overrides)
    views = lockstep.graph.row.views
    chain = lockstep.graph.laws[1].controller._fingers[0].chain  # type: ignore[attr-defined]
    found: Array = views["world.finger_tip"] - np.array(chain.forward(views["world.finger_position"].tolist()))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["moca-man", "kairos-man"])
def test_an_arm_that_is_mounted_elsewhere(name: str) -> None:
    right, wrong = tool_error(name), tool_error(name, "sim.parts.arm.off_by={position: [0.02, 0, 0]}")
    assert np.linalg.norm(right) < 0.001
    assert wrong - right == pytest.approx([0.02, 0.0, 0.0], abs=2e-4)
    lever = tool_error(name, "sim.parts.arm.off_by={rpy: [0, 0, 0.02]}")
    x, y = run(name).graph.row.views["tool.pose"][:2] - profile.load(name)[0].frames["arm"].position[:2]
    assert np.linalg.norm(lever - right) == pytest.approx(2 * np.sin(0.01) * np.hypot(x, y), abs=2e-4)
    print(f"{name}: 20 mm -> {1e3 * np.linalg.norm(wrong):.1f} mm; 0.02 rad -> {1e3 * np.linalg.norm(lever):.1f} mm")


def test_a_finger_that_is_worn_elsewhere() -> None:
    right, wrong = finger_error(), finger_error("sim.parts.finger.off_by={position: [0.02, 0, 0]}")
    assert np.linalg.norm(right) < 1e-9
    # In the axes of its frame, whose x points out of the palm: -z of the hand.
    assert wrong == pytest.approx([0.0, 0.0, -0.02], abs=1e-9)
    turned = finger_error("sim.parts.finger.off_by={rpy: [0, 0, 0.02]}")
    assert np.linalg.norm(turned) < 0.02 * 0.141  # at most its length away from the axis
    print(f"finger: 20 mm -> {1e3 * np.linalg.norm(wrong):.1f}; 0.02 rad -> {1e3 * np.linalg.norm(turned):.1f} mm")


@pytest.mark.parametrize(("name", "part"), [("moca-man", "arm"), ("moca-man", "sensor"), ("sixth-finger", "finger")])
def test_no_law_knows_of_it(name: str, part: str) -> None:
    usual, off = (
        wiring.build(*profile.load(name, overrides), [])
        for overrides in ((), (f"sim.parts.{part}.off_by={{position: [0.02, 0, 0]}}",))
    )
    assert transforms(usual) == transforms(off)


@pytest.mark.parametrize(
    ("name", "frame", "law", "body"),
    [
        ("moca-man", "arm", "tool.mount", "arm/base"),
        ("moca-man", "handle", "guide.sensor", "sensor/tool"),
        ("sixth-finger", "finger", "mapping.finger", "finger/base"),
    ],
)
def test_one_change_of_a_frame_moves_law_and_world_and_picture(name: str, frame: str, law: str, body: str) -> None:
    checked, _ = profile.load(name)
    x, y, z = checked.frames[frame].position
    there = f"frames.{frame}.position=[{x}, {y + 0.05}, {z}]"
    usual, moved = (wiring.build(*profile.load(name, change), []) for change in ((), (there,)))
    (before,), (after,) = ([t for t in transforms(g) if t["name"] == law] for g in (usual, moved))
    assert np.subtract(after["position"], before["position"]) == pytest.approx([0, 0.05, 0], abs=1e-12)
    places = [g.world.data.body(body).xpos - g.world.data.body(_parent(g.world, body)).xpos for g in (usual, moved)]  # type: ignore[union-attr]
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(0.05, abs=1e-9)
    seen = [g.layout.meta["frames"][frame]["position"] for g in (usual, moved)]
    assert np.linalg.norm(np.subtract(*seen)) == pytest.approx(0.05, abs=1e-9)


def _parent(world: Any, body: str) -> int:
    """The body on which the part of this body stands."""
    at, part = world.model.body(body).id, body.partition("/")[0]
    while world.model.body(at).name.partition("/")[0] == part:
        at = int(world.model.body_parentid[at])
    return int(at)
