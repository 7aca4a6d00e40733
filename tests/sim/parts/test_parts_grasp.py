"""What the grasping experiment stands on: objects on a table, a hand that doesn't grasp, what carries it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.sim import MS
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.runtime.models.human_hand import FINGERS
from srl.runtime.models.models import HandModel, context
from srl.sim.parts.body.carrier import CarrierPart
from srl.sim.parts.hand.objects import ObjectPart
from srl.sim.parts.hand.ycb import YCB
from srl.sim.world.cell import Cell, CellConfig

# Lisini Baldi et al. 2023, table I: g, mm.
TABLE = {
    "A": (84, (60, 60, 60)), "B": (191, (96,)), "C": (205, (75, 250)), "D": (349, (66, 101)), "E": (14, (60, 62)),
    "F": (21, (75, 68)), "G": (28, (85, 72)), "H": (35, (95, 76)), "I": (68, (75,)), "L": (133, (89, 137)),
    "M": (370, (50, 97, 82)),
}  # fmt: skip


def cell(parts: dict[str, Any], **options: Any) -> Cell:
    return Cell(CellConfig.model_validate({"parts": parts, **options}, context=context({})), 1)


def standing(code: str, **options: Any) -> dict[str, Any]:
    place = [0.0, -0.15, YCB[code].height / 2 + 1e-4]
    thing = {"part": "object", "shape": "ycb", "code": code, "at": {"position": place}} | options
    return {"table": {"part": "table"}, "thing": thing}


@pytest.mark.parametrize("code", TABLE)
def test_an_object_has_the_papers_mass_and_size(code: str) -> None:
    world = cell(standing(code))
    grams, size = TABLE[code]
    body = world.model.body("thing/body")
    assert body.mass[0] == pytest.approx(grams * 1e-3)
    corners = []
    for geom in range(world.model.ngeom):
        if world.model.geom(geom).name.startswith("thing/"):
            middle, half = world.model.geom_aabb[geom, :3], world.model.geom_aabb[geom, 3:]
            turn = Rotation.from_quat(world.model.geom_quat[geom], scalar_first=True)
            if world.model.geom_dataid[geom] >= 0:  # a mesh turns its own axes: its corners tell
                mesh = world.model.mesh(int(world.model.geom_dataid[geom]))
                first, number = int(mesh.vertadr[0]), int(mesh.vertnum[0])
                found = world.model.mesh_vert[first : first + number]
            else:
                signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
                found = middle + signs * half
            corners.append(turn.apply(found) + world.model.geom_pos[geom])
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    expected = {1: size * 3, 2: (size[0], size[0], size[-1]), 3: size}[len(size)]
    np.testing.assert_allclose(high - low, np.array(expected) * 1e-3, atol=1e-6)
    assert low[2] == pytest.approx(-YCB[code].height / 2)


@pytest.mark.parametrize("code", TABLE)
def test_an_objects_inertia_is_one_that_a_body_can_have(code: str) -> None:
    x, y, z = YCB[code].inertia
    assert x + y > z
    assert y + z > x
    assert z + x > y
    reach = max(YCB[code].size) / 2 + abs(YCB[code].centre)
    assert max(x, y, z) < YCB[code].mass * 2 * reach**2


@pytest.mark.parametrize("code", TABLE)
def test_an_object_stands_still_on_the_table(code: str) -> None:
    world = cell(standing(code))
    world.advance(1000 * MS)
    first = world.truth_arrays["thing_pose"].copy()
    np.testing.assert_allclose(first[:3], [0.0, -0.15, YCB[code].height / 2], atol=5e-4)
    world.advance(3000 * MS)
    np.testing.assert_allclose(world.truth_arrays["thing_pose"], first, atol=1e-4)
    np.testing.assert_array_equal(world.truth_arrays["thing_position"], world.truth_arrays["thing_pose"][:3])


def test_an_object_can_be_put_elsewhere() -> None:
    world = cell(standing("D"))
    world.advance(200 * MS)
    thing = world.parts["thing"]
    assert isinstance(thing, ObjectPart)
    thing.put((0.1, 0.1, 0.0506, 1.0, 0.0, 0.0, 0.0))
    world.advance(1000 * MS)
    np.testing.assert_allclose(world.truth_arrays["thing_pose"], [0.1, 0.1, 0.0505, 1, 0, 0, 0], atol=1e-3)


def test_on_a_slope_friction_decides_and_a_ball_rolls() -> None:
    """Steeper than the arc tangent of its friction, a cube slides; a ball rolls on a slope on which the cube stays."""

    def moved(code: str, slope: float, friction: float) -> float:
        gravity = [9.81 * np.sin(slope), 0.0, -9.81 * np.cos(slope)]
        parts = standing(code) | {"table": {"part": "table", "friction": friction}}
        world = cell(parts, gravity=gravity)
        world.advance(500 * MS)
        return float(world.truth_arrays["thing_pose"][0])

    assert moved("A", np.arctan(0.4) - 0.03, 0.4) < 0.002
    assert moved("A", np.arctan(0.4) + 0.03, 0.4) > 0.01
    assert moved("I", np.arctan(0.4) - 0.03, 0.4) > 0.1
    free = 0.5 * 5 / 7 * 9.81 * 0.005 * 0.5**2  # m, of a solid ball without rolling resistance
    assert moved("I", 0.005, 0.4) < 0.5 * free


def test_the_passive_hand_is_the_models_hand_in_its_posture() -> None:
    model = HandModel(length=0.2)
    world = Cell(
        CellConfig.model_validate(
            {"parts": {"hand": {"part": "passive-hand", "posture": [0.0] * 20}}}, context=context({"hand": model})
        ),
        1,
    )
    bases, rows = model.geometry()
    for finger, base, row in zip(FINGERS, bases, rows, strict=True):
        straight = base @ np.array([row[:, 1].sum(), 0.0, 0.0, 1.0])
        joint = [name for name in model.names if name.startswith(finger)][-1]
        geom = world.data.geom(f"hand/{joint}")
        end = geom.xpos + geom.xmat.reshape(3, 3)[:, 2] * world.model.geom(f"hand/{joint}").size[1]
        start = geom.xpos - geom.xmat.reshape(3, 3)[:, 2] * world.model.geom(f"hand/{joint}").size[1]
        nearest = min(np.linalg.norm(end - straight[:3]), np.linalg.norm(start - straight[:3]))
        assert nearest < (1e-9 if finger != "thumb" else 0.02)  # the thumb isn't straight at zero


def carried(at: dict[str, Any] | None = None) -> tuple[Cell, CarrierPart]:
    parts = {
        "arm": {"part": "carrier"} | ({"at": at} if at else {}),
        "hand": {"part": "passive-hand", "at": "arm/body"},
    }
    world = cell(parts)
    arm = world.parts["arm"]
    assert isinstance(arm, CarrierPart)
    return world, arm


@pytest.mark.slow
@given(
    st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3),
    st.floats(0.3, 2.0),
)
def test_the_carriers_path_is_smooth_and_ends_where_it_was_told(
    place: list[float], turn: list[float], s: float
) -> None:
    _, arm = carried()
    goal = (*place, *Rotation.from_rotvec(turn).as_quat(scalar_first=True).tolist())
    arm.go(goal, s)
    np.testing.assert_allclose(arm.path(0.0), [0, 0, 0, 1, 0, 0, 0], atol=1e-12)
    end = np.array(arm.path(s))
    np.testing.assert_allclose(end[:3], place, atol=1e-12)
    assert abs(end[3:] @ goal[3:]) == pytest.approx(1.0, abs=1e-9)
    times = np.linspace(0.0, s, 101)
    path = np.array([arm.path(t)[:3] for t in times])
    fastest = np.linalg.norm(np.diff(path, axis=0), axis=1).max() / (s / 100)
    assert fastest <= 1.875 * np.linalg.norm(place) / s + 1e-9  # minimum jerk: 15/8 of the mean speed
    assert not arm.there


def test_the_carrier_follows_its_path_and_a_new_word_begins_where_it_is() -> None:
    world, arm = carried({"position": [0.0, 0.0, 0.5]})
    arm.go((0.3, 0.1, 0.6, 1.0, 0.0, 0.0, 0.0), 0.8)
    for _ in range(40):
        world.advance(world.time + 10 * MS)
        assert np.linalg.norm(world.truth_arrays["arm_pose"][:3] - arm.path(world.time * 1e-9)[:3]) < 0.02
    before = arm.path(world.time * 1e-9)
    arm.go((0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0), 0.5)
    np.testing.assert_allclose(arm.path(world.time * 1e-9), before, atol=1e-12)
    world.advance(world.time + 1000 * MS)
    assert arm.there
    np.testing.assert_allclose(world.truth_arrays["arm_pose"], [0, 0, 0.5, 1, 0, 0, 0], atol=1e-3)


def test_a_carrier_goes_on_bit_for_bit_after_a_restore() -> None:
    (world, arm), (other, _) = carried(), carried()
    arm.go((0.2, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0), 0.6)
    world.advance(300 * MS)
    other.restore(world.save())
    for each in (world, other):
        each.advance(700 * MS)
    assert world.save().tobytes() == other.save().tobytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"part": "passive-hand", "posture": {"index_mcp_flexion": 0.1}}, "missing"),
        ({"part": "passive-hand", "friction": 0.0}, "greater than 0"),
        ({"part": "table", "size": [0.0, 1.0]}, "greater than 0"),
        ({"part": "table", "goal": [float("nan"), 0.0]}, "finite"),
        ({"part": "carrier", "mass": 0.0}, "greater than 0"),
        ({"part": "object", "shape": "cup", "size": [0.1, 0.1], "mass": 1.0}, "shape"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        CellConfig.model_validate({"parts": {"thing": options}})


@pytest.mark.parametrize(("torque", "turns"), [(0.04, False), (0.06, True)])
def test_a_bottles_cap_turns_above_its_dry_friction_and_not_below_it(torque: float, turns: bool) -> None:
    bottle = {"part": "bottle", "torque": 0.05, "at": {"position": [0.0, 0.0, 0.0751]}}
    world = cell({"table": {"part": "table"}, "thing": bottle}, noslip=5)
    assert world.model.opt.noslip_iterations == 5
    body = world.model.body("thing/cap").id
    assert world.model.body("thing/body").mass[0] == pytest.approx(0.3)
    world.advance(100 * MS)
    world.data.xfrc_applied[body, 5] = torque
    world.advance(300 * MS)
    assert (world.truth_arrays["thing_cap"][0] > 0.1) == turns


def test_a_door_handles_spring_has_the_torques_that_it_says() -> None:
    """Held by a torque between those of both ends, it rests where the spring's line says."""
    world = cell({"thing": {"part": "door-handle", "start": 0.2, "end": 0.4, "turn": 0.7}}, gravity=[0.0, 0.0, 0.0])
    joint = world.model.joint("thing/turn")
    for torque, turn in ((0.1, 0.0), (0.3, 0.35), (0.4, 0.7)):
        world.data.qfrc_applied[int(joint.dofadr[0])] = torque
        world.advance(world.time + 1500 * MS)
        assert world.truth_arrays["thing_turn"][0] == pytest.approx(turn, abs=0.01)
