"""One description of finger and hand: the law's tip is the world's, whatever `models:` says, in one place."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from helpers.control import WORN
from helpers.sim import world

from srl.control.hand.extra_finger import FingerKinematics
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import FingerModel, HandModel
from srl.runtime.models.point_series import PointSeries
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph
from srl.sim.wearer.joints import to_glove
from srl.sim.world.cell import Cell

USUAL = "  finger: {kind: finger}"
SHORT = "  finger: {kind: finger, rows: [[1.5707963267948966, 0.015], [0, 0.03], [0, 0.042], [0, 0.042]]}"
STIFF = "  finger: {kind: finger, upper: [1.0, 0.4, 1.0, 1.0]}"
HAND = "length: 0.189}"
SMALL = "length: 0.16}"
LEFT = "side: left, length: 0.205}"


def build(old: str = "", new: str = "") -> Graph:
    """sixth-finger, with one thing of `models:` changed."""
    text = profile.find("sixth-finger")[1]
    assert text.count(old) == 1 or not old
    return wiring.build(*profile.parse("finger.yaml", text.replace(old, new) if old else text), [])


def posture(graph: Graph, rng: np.random.Generator) -> tuple[Array, Array]:
    """Random angles of hand (20,) and finger (4,) within their ranges, rad; the middle finger's abduction is zero."""
    world = graph.world
    assert isinstance(world, Cell)
    ranges = [np.array([world.model.joint(n).range for n in names(world, part)]) for part in ("hand", "finger")]
    hand, finger = (low + rng.uniform(size=len(low)) * (high - low) for low, high in (r.T for r in ranges))
    hand[8] = 0.0
    return hand, finger


def names(world: Cell, part: str) -> list[str]:
    found = (world.model.joint(i).name for i in range(world.model.njnt))
    return [name for name in found if name.startswith(f"{part}/")]


def tips(graph: Graph, hand: Array, finger: Array) -> tuple[Array, Array]:
    """The tips of hand and finger (6, 3), m, in frame hand: by the laws, and by the world."""
    views, world = graph.row.views, graph.world
    assert isinstance(world, Cell)
    views["glove.position"][:] = to_glove(hand)
    views["finger.position_command.applied"][:] = finger
    for law in graph.laws:
        law.controller.reset()
    for part, angles in (("hand", hand), ("finger", finger)):
        for name, angle in zip(names(world, part), angles, strict=True):
            world.data.joint(name).qpos[0] = angle
    mujoco.mj_kinematics(world.model, world.data)
    for part in world.parts.values():
        part.fill(views_of(graph))
    return (
        np.vstack([views["hand.tips"], views["mapping.skeleton"][-1]]),
        np.vstack([views["world.hand_tips"], views["world.finger_tip"]]),
    )


def views_of(graph: Graph) -> dict[str, Array]:
    return {name.removeprefix("world."): view for name, view in graph.row.views.items() if name.startswith("world.")}


@pytest.mark.parametrize(
    ("old", "new"), [(USUAL, SHORT), (USUAL, STIFF), (HAND, SMALL), ("side: right, " + HAND, LEFT)]
)
def test_what_changes_in_one_place_changes_for_law_and_world(old: str, new: str) -> None:
    before, after, rng = build(), build(old, new), np.random.default_rng(5)
    moved = 0.0
    for _ in range(20):
        angles = posture(after, rng)
        found = [tips(graph, *angles) for graph in (before, after)]
        for law, simulated in found:
            np.testing.assert_allclose(simulated, law, atol=1e-9)
        moved = max(moved, float(np.abs(found[1][1] - found[0][1]).max()))
    assert moved > (0.002 if new != STIFF else -1.0)


def test_limits_are_those_of_law_and_world() -> None:
    graph = build(USUAL, STIFF)
    law = graph.laws[1].controller.config.fingers[0].model  # type: ignore[attr-defined]
    assert isinstance(graph.world, Cell)
    ranges = [graph.world.model.joint(name).range for name in names(graph.world, "finger")]
    np.testing.assert_array_equal(ranges, np.transpose([law.lower, law.upper]))
    assert law.upper[1] == 0.4


CHAINS = {
    "one joint": ((0.0, 0.05),),
    "two": ((0.7, 0.01), (-0.3, 0.06)),
    "axes that meet": ((1.2, 0.02), (-1.5, 0.0), (0.4, 0.05)),
    "turned every way": ((1.57, 0.015), (-0.8, 0.03), (0.5, 0.04), (0.2, 0.03), (-1.1, 0.02), (0.3, 0.01)),
    "backwards": ((0.3, -0.02), (0.0, 0.04)),
}


@pytest.mark.parametrize("chain", CHAINS)
def test_any_rows_build_and_agree(chain: str) -> None:
    rows, rng = CHAINS[chain], np.random.default_rng(3)
    n = len(rows)
    model = FingerModel(rows=rows, lower=(-1.2,) * n, upper=(1.3,) * n)
    law = FingerKinematics(model, homogeneous(WORN), 0.01).chain
    cell = world(models={"odd": model}, fingers=[{"model": "odd"}])
    joints = [f"finger/{name}" for name in model.names]
    for _ in range(20):
        q = rng.uniform(-1.2, 1.3, n)
        for joint, angle in zip(joints, q, strict=True):
            cell.data.joint(joint).qpos[0] = angle
        mujoco.mj_kinematics(cell.model, cell.data)
        np.testing.assert_allclose(cell.data.site("finger/tip").xpos, law.forward(q.tolist()), atol=1e-9)
    cell.servos.set(dict.fromkeys(model.names, 0.1))
    cell.advance(500_000_000)
    np.testing.assert_allclose(cell.truth_arrays["finger_position"], 0.1, atol=0.05)


def test_a_larger_hand_is_heavier_by_the_cube() -> None:
    small, large = (world(models={"hand": HandModel(length=s * 0.189)}).model for s in (1.0, 1.2))
    masses = [m.body("hand/base").subtreemass[0] - m.body("finger/base").subtreemass[0] for m in (small, large)]
    assert masses[1] == pytest.approx(1.2**3 * masses[0], rel=0.05)  # but for the specks at the knuckles


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize(
    "place",
    [
        {"at": {"position": [0.3, -0.2, 0.5], "quaternion": [0.5, 0.5, -0.5, 0.5]}},
        {"at": {"parent": "arm/flange", "position": [0, 0, 0.1], "quaternion": [0.8, 0.0, 0.6, 0.0]}},
    ],
)
def test_tips_are_in_the_hands_own_frame_wherever_it_is(side: str, place: dict[str, dict[str, object]]) -> None:
    hand = HandModel(side=side)
    cell = world(models={"hand": hand}, hand=place, parts={"arm": {"part": "panda"}})
    for servo in range(4):
        cell.set_servo(servo, 0.3)
    start = cell.data.body("hand/base").xpos.copy()
    cell.data.qvel[cell.model.joint("arm/joint1").dofadr[0] if "parent" in place["at"] else slice(0)] = 1.0
    cell.advance(300_000_000)
    truth = cell.truth_arrays
    expected = PointSeries(*hand.geometry()).at(truth["hand_position"])[3::4]
    np.testing.assert_allclose(truth["hand_tips"], expected, atol=1e-9)
    law = FingerKinematics(FingerModel(), homogeneous(WORN), 0.01).chain
    np.testing.assert_allclose(truth["finger_tip"], law.forward(truth["finger_position"].tolist()), atol=1e-9)
    if "parent" in place["at"]:
        assert np.linalg.norm(cell.data.body("hand/base").xpos - start) > 1e-4, "the arm didn't move"


def test_a_finger_on_anything_else_is_seen_from_the_world() -> None:
    cell = world(fingers=[{"at": "arm/flange"}], parts={"arm": {"part": "panda"}})
    assert {s.name: s.frame for s in cell.truth}["finger_tip"] is None
    np.testing.assert_allclose(cell.truth_arrays["finger_tip"], cell.data.site("finger/tip").xpos)
