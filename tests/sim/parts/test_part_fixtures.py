"""The fixtures of the SUPER-MAN experiments: what touches, how hard, how far, against geometry done by hand."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.person import HEAVY, MS, Trolley, cell, finished, put, run
from pydantic import ValidationError

from srl.sim.parts.person.person import PersonPart
from srl.sim.parts.person.plans import drilling, peg_in_hole
from srl.sim.parts.things.box import BoxPart
from srl.sim.parts.things.drill_plate import DrillPart, PlatePart
from srl.sim.parts.things.load import ObstaclesPart
from srl.sim.parts.things.peg_hole import HolePart, PegPart
from srl.sim.parts.things.wire_ring import RingPart, WireConfig, WirePart

SIDES = [(np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4]


def moved(fixture: dict[str, Any], tool: dict[str, Any], **options: Any) -> Any:
    """A cell with a fixture and a tool on a trolley that a test moves about."""
    return cell({"robot": (Trolley, HEAVY)} | fixture | tool, **options)


def farthest(world: Any, part: Any, direction: tuple[float, float, float], most: float) -> float:
    """m along a direction from the origin, up to where nothing touches yet."""
    low, high = 0.0, most
    while high - low > 2e-5:
        middle = (low + high) / 2
        put(world, *(middle * np.array(direction)))
        low, high = (low, middle) if part.touches.touching else (middle, high)
        put(world, 0, 0, 0)
    return low


# -- 1, the wire


def straight(**ring: Any) -> Any:
    wire = {"points": [(-0.2, 0, 0), (0.2, 0, 0)], "radius": 0.003}
    return moved({"wire": (WirePart, wire)}, {"ring": (RingPart, {"at": "robot/body", **ring})})


def test_a_ring_of_3_cm_has_its_clearance_all_round():
    world = straight()
    put(world, 0, 0, 0)
    assert not world.parts["wire"].touches.touching
    for y, z in SIDES:
        free = farthest(world, world.parts["wire"], (0, y, z), 0.03)
        assert free == pytest.approx(0.015 - 0.003, abs=3e-4)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_the_rings_axis_is_the_one_named(axis):
    along = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}[axis]
    points = [tuple(-0.2 * v for v in along), tuple(0.2 * v for v in along)]
    world = moved({"wire": (WirePart, {"points": points})}, {"ring": (RingPart, {"at": "robot/body", "axis": axis})})
    put(world, *(0.1 * np.array(along)))
    assert not world.parts["wire"].touches.touching
    assert world.model.body("ring/ring").mass[0] == pytest.approx(0.05)


def test_touches_are_counted_once_each():
    world = straight()
    for _ in range(5):
        put(world, 0, 0.0125, 0, 0.1)
        put(world, 0, 0, 0, 0.5)
    put(world, 0, 0.0125, 0, 0.1)
    put(world, 0, 0, 0, 0.1)  # comes back too soon: still the same
    put(world, 0, 0.0125, 0, 0.1)
    put(world, 0, 0, 0, 0.02)
    count, now, seconds = world.truth_arrays["wire_touches"]
    assert (count, now) == (6, 0)
    assert seconds == pytest.approx(0.7, abs=0.02)


def test_the_force_on_the_wire_points_away_from_the_ring():
    world = straight()
    put(world, 0, 0.0122, 0, 0.002)  # the ring's -y side presses the wire towards +y
    assert world.truth_arrays["wire_force"][1] > 0.1
    assert np.abs(world.truth_arrays["wire_force"][[0, 2]]).max() < 0.05 * world.truth_arrays["wire_force"][1]


def test_sites_lie_along_the_wire_and_marks_on_it():
    world = cell({"wire": (WirePart, {"at": {"position": [1, 2, 3]}}), "box": (BoxPart, {"size": [0.1, 0.1, 0.1]})})
    path, model = world.parts["wire"].path, world.model
    sites = [i for i in range(model.nsite) if model.site(i).name.startswith("wire/path_")]
    places = world.data.site_xpos[sites] - [1, 2, 3]
    np.testing.assert_allclose(places[[0, -1]], [(0, 0, 0), (0.9, 0, 0.05)], atol=1e-9)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 0.0215
    assert steps.sum() == pytest.approx(path.length, rel=2e-3)
    marks = [world.data.site(f"wire/mark_{k}").xpos - [1, 2, 3] for k in range(3)]
    for share, mark in zip((0.25, 0.5, 0.75), marks, strict=True):
        np.testing.assert_allclose(mark, path.at(share * path.length)[:3], atol=1e-9)
    with pytest.raises(ValidationError, match="two points"):
        WireConfig.model_validate({"points": [[0, 0, 0]]})


# -- 2, the plate


def plate(**options: Any) -> Any:
    """A plate whose first hole is over the drill's tip, which is 5 cm below it."""
    fixed = {"rows": 2, "columns": 3, "at": {"position": [0.3, 0.15, 0.41]}, "drill": "drill/tip", **options}
    return moved({"plate": (PlatePart, fixed)}, {"drill": (DrillPart, {"at": "robot/body"})})


def test_holes_are_7_cm_wide_and_30_cm_apart():
    world = plate()
    holes = np.array([world.data.site(f"plate/hole_{k}").xpos for k in range(6)])
    np.testing.assert_allclose(np.linalg.norm(np.diff(holes, axis=0), axis=1), 0.3, atol=1e-9)
    np.testing.assert_allclose(holes[0], [0, 0, 0.4], atol=1e-9)
    assert len(PlatePart("p", PlatePart.Config(), 0).holes) == 20
    put(world, 0, 0, 0.1)
    for x, y in SIDES:
        low, high = 0.0, 0.05
        while high - low > 2e-5:
            middle = (low + high) / 2
            put(world, middle * x, middle * y, 0.1)
            low, high = (low, middle) if world.parts["plate"].touches.touching else (middle, high)
            put(world, 0, 0, 0)
        assert low == pytest.approx(0.035 - 0.01, abs=6e-4)


def test_between_the_holes_there_is_plate_everywhere():
    world = plate()
    rng = np.random.default_rng(0)
    holes = np.array(world.parts["plate"].holes) + np.array([0.3, 0.15])
    for _ in range(150):
        x, y = rng.uniform(-0.13, 0.73), rng.uniform(-0.13, 0.43)
        clear = np.linalg.norm(holes - [x, y], axis=1).min()
        put(world, x, y, 0.06, 0.004)  # the tip is 1 cm into the plate
        if clear < 0.024:
            assert not world.parts["plate"].touches.touching
        elif clear > 0.026:
            assert world.parts["plate"].touches.touching, (x, y)


def test_the_stay_in_a_hole_is_measured_and_ends_with_a_touch():
    world = plate()
    put(world, 0.3, 0, 0.09, 2.0)
    assert world.truth_arrays["plate_inside"][0] == 1
    put(world, 0.3, 0, 0.0, 0.1)
    assert world.truth_arrays["plate_inside"][0] == -1
    put(world, 0, 0, 0.09, 1.0)
    put(world, 0.03, 0, 0.09, 0.05)
    put(world, 0, 0, 0.09, 0.5)
    np.testing.assert_allclose(world.truth_arrays["plate_dwell"], [1.0, 2.0, 0, 0, 0, 0], atol=0.01)
    assert world.truth_arrays["plate_touches"][0] == 1


@pytest.mark.slow
def test_a_person_drills_overhead_alone():
    parts: Any = {
        "plate": (PlatePart, {"at": {"position": [0, 0, 2]}, "drill": "drill/tip", "rows": 1, "columns": 2}),
        "person": (PersonPart, {"at": {"position": [0, 0, 1.5]}, "plan": drilling(holes=2), "tool": "drill/tip"}),
        "drill": (DrillPart, {"at": {"parent": "person/hand", "position": [0, 0, -0.1]}}),
    }
    world = cell(parts)
    run(world, 60, until=finished, every=50)
    assert world.truth_arrays["plate_dwell"].min() > 5.0
    assert world.truth_arrays["plate_touches"][0] == 0
    assert world.truth_arrays["person_progress"][1] == 0


# -- 3, peg and hole


def pegged(**options: Any) -> Any:
    """The peg's tip is 2 cm over the mouth, which is at z = -0.1."""
    fixed = {"at": {"position": [0, 0, -0.1]}, "peg": "peg/tip", **options}
    peg = {"at": {"parent": "robot/body", "quaternion": [0, 1, 0, 0]}}
    return moved({"hole": (HolePart, fixed)}, {"peg": (PegPart, peg)}, gravity=(0.0, 0.0, 0.0))


def test_the_peg_fits_with_its_clearance():
    world = pegged()
    hole = world.parts["hole"]
    for x, y in SIDES[:4]:
        low, high = 0.0, 0.003
        while high - low > 1e-5:
            middle = (low + high) / 2
            put(world, middle * x, middle * y, -0.05, 0.003)
            low, high = (low, middle) if hole.touches.touching else (middle, high)
            put(world, 0, 0, 0, 0.05)
        assert low == pytest.approx(0.0005, abs=4e-5)
    put(world, 0, 0, -0.05)
    assert world.truth_arrays["hole_depth"][0] == pytest.approx(0.03, abs=1e-6)
    put(world, 0, 0, -0.01)
    assert world.truth_arrays["hole_depth"][0] == 0.0


def test_a_push_beside_the_hole_moves_the_block_by_its_stiffness():
    parts: Any = {
        "robot": (Trolley, {"mass": 1.0, "damping": 500.0, "turn_damping": 500.0}),
        "hole": (HolePart, {"at": {"position": [0, 0, -0.1]}}),
        "peg": (PegPart, {"at": {"parent": "robot/body", "position": [0.03, 0, 0], "quaternion": [0, 1, 0, 0]}}),
    }
    world = cell(parts, gravity=(0.0, 0.0, 0.0))
    world.data.xfrc_applied[world.model.body("robot/body").id, 2] = -20.0
    world.advance(2000 * MS)
    np.testing.assert_allclose(world.truth_arrays["hole_force"], [0, 0, -20.0], atol=0.3)
    assert float(world.data.joint("hole/z").qpos[0]) == pytest.approx(-20.0 / 5e4, rel=0.03)


@pytest.mark.parametrize(("off", "chamfer"), [(0.002, 0.004), (0.003, 0.004), (0.006, 0.008), (0.007, 0.008)])
def test_a_nose_that_is_off_meets_the_chamfer_where_geometry_says(off, chamfer):
    world = pegged(chamfer=chamfer)
    hole = world.parts["hole"]
    r, R = 0.015, 0.0155
    low, high = 0.0, 0.04
    while high - low > 1e-5:
        middle = (low + high) / 2
        put(world, off, 0, -middle, 0.003)
        low, high = (low, middle) if hole.touches.touching else (middle, high)
        put(world, 0, 0, 0, 0.05)
    # The nose's centre is at (off, h) over the mouth. The slope is x - z = R + chamfer, its lower edge (R, -chamfer).
    slope = r * np.sqrt(2) - (R + chamfer) + off
    edge = np.sqrt(r**2 - (R - off) ** 2) - chamfer
    h = slope if slope - r / np.sqrt(2) > -chamfer else edge
    assert low == pytest.approx(0.02 + r - h, abs=1.5e-4)


@pytest.mark.slow
def test_a_person_puts_the_peg_in_and_draws_it_out():
    parts: Any = {
        "hole": (HolePart, {"at": {"position": [0, 0, 1]}, "peg": "peg/tip"}),
        "person": (PersonPart, {"at": {"position": [0.05, 0, 1.2]}, "plan": peg_in_hole(), "tool": "peg/tip"}),
        "peg": (PegPart, {"at": {"parent": "person/hand", "quaternion": [0, 1, 0, 0]}}),
    }
    world = cell(parts)
    seen = run(world, 60, until=finished)
    assert seen["hole_depth"].max() > 0.028
    assert seen["hole_depth"][-1] == 0
    assert 0.5 < np.linalg.norm(seen["hole_force"], axis=1).max() < 29.4
    assert world.truth_arrays["person_progress"][1] == 0


@pytest.mark.slow
def test_an_insertion_pushes_no_harder_than_told():
    parts: Any = {
        "hole": (HolePart, {"at": {"position": [0.03, 0, 1]}, "peg": "peg/tip"}),  # beside the hole
        "person": (
            PersonPart,
            {
                "at": {"position": [0, 0, 1.12]},
                "tool": "peg/tip",
                "noise": 0.0,
                "tremor": 0.0,
                "plan": [{"do": "insert", "direction": [0, 0, -2], "depth": 0.06, "force": 12, "patience": 3}],
            },
        ),
        "peg": (PegPart, {"at": {"parent": "person/hand", "quaternion": [0, 1, 0, 0]}, "mass": 0.1}),
    }
    world = cell(parts)
    seen = run(world, 5.0)
    pressing = seen["hole_force"][-50:, 2].mean()
    assert pressing == pytest.approx(-12.0, abs=0.6 + 0.1 * 9.81)
    run(world, 10, until=finished)
    assert world.truth_arrays["person_progress"][1] == 1  # it counts as missed


# -- all of them


@pytest.mark.slow
def test_what_was_counted_goes_on_from_a_saved_state_bit_for_bit():
    parts: Any = {
        "wire": (WirePart, {"at": {"position": [0, 0, 1]}, "points": [(-0.2, 0, 0), (0.2, 0, 0)]}),
        "plate": (PlatePart, {"at": {"position": [0, 0, 1.55]}, "drill": "drill/tip", "rows": 1, "columns": 1}),
        "hole": (HolePart, {"at": {"position": [0, 0, 0.7]}}),
        "things": (ObstaclesPart, {"boxes": [{"position": [1, 0, 0], "size": [1, 1, 1]}], "watch": ["machine/body"]}),
        "person": (
            PersonPart,
            {
                "at": {"position": [0, 0, 1]},
                "plan": [{"do": "go_to", "by": [0.0, 0.03, 0.1], "patience": 100}],
                "tremor": 0.002,
            },
        ),
        "machine": (BoxPart, {"at": "person/hand", "size": [0.05, 0.05, 0.05], "mass": 1.0, "touches": False}),
        "ring": (RingPart, {"at": "person/hand"}),
        "drill": (DrillPart, {"at": {"parent": "person/hand", "position": [0.0, 0.02, 0.2]}, "mass": 0.5}),
        "peg": (PegPart, {"at": {"parent": "person/hand", "position": [0, 0, -0.22], "quaternion": [0, 1, 0, 0]}}),
    }
    world = cell(parts)
    assert mujoco.mj_stateSize(world.model, mujoco.mjtState.mjSTATE_INTEGRATION) > 0
    states = []
    for k in range(40):
        world.advance((k + 1) * 97 * MS)
        states.append(world.save())
    assert world.truth_arrays["wire_touches"][2] > 0
    fresh = cell(parts)
    for k in (0, 9, 14, 15, 16, 20, 30):
        fresh.restore(states[k])
        fresh.advance((k + 2) * 97 * MS)
        np.testing.assert_array_equal(fresh.save(), states[k + 1])
