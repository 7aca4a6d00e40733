"""The SoftHand of the cell: synergy, adaptation, current, grasp."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from helpers.shared import shared
from helpers.sim import MS
from ruamel.yaml import YAML

from srl.sim.parts.robots.softhand import CLOSED, SoftHandPart
from srl.sim.world.cell import Cell, CellConfig

FLOATING = (0.0, 0.0, 0.0)
ONTO_THE_PALM = (-9.81, 0.0, 0.0)


def cell(gravity: tuple[float, float, float] = FLOATING, **parts: dict[str, Any]) -> Cell:
    return Cell(CellConfig.model_validate({"gravity": gravity, "parts": {"hand": {"part": "softhand"}} | parts}), 1)


def hand(world: Cell) -> SoftHandPart:
    return cast(SoftHandPart, world.parts["hand"])


def run(world: Cell, seconds: float) -> None:
    for _ in range(round(seconds * 100)):
        world.advance(world.time + 10 * MS)


def bar(diameter: float, **options: Any) -> dict[str, Any]:
    """A cylinder across the palm."""
    across = {"position": (0.022 + diameter / 2, 0.0, 0.145), "quaternion": (0.7071, 0.7071, 0, 0)}
    return {"part": "box", "shape": "cylinder", "size": (diameter, 0.2), "at": across} | options


def test_the_empty_hand_closes_along_its_synergy() -> None:
    facts = YAML(typ="safe").load(shared("facts/softhand.yaml"))
    world = cell()
    part = hand(world)
    assert len(part.labels) == facts["joints"]
    part.command_position(0.5 * CLOSED)
    run(world, 2.0)
    assert part.position == pytest.approx(0.5 * CLOSED, abs=0.02)
    sigma = np.pi / 4 * part.position / CLOSED
    names = {"abduction": "abd"}
    for label, angle in zip(part.labels, part.joints(), strict=True):
        finger, joint = label.split("_")
        factor = facts["synergy_vector"][f"{finger}_{names.get(joint, joint)}"]
        pair = 1 if joint == "abduction" else 2  # the sheet gives each hinge of a rolling pair
        assert angle == pytest.approx(pair * factor * sigma, abs=0.04), label


def test_it_closes_in_the_time_of_the_sheet_and_opens_by_its_springs() -> None:
    world = cell()
    part = hand(world)
    part.command_position(CLOSED)
    while part.position < 0.95 * CLOSED:
        assert world.time < 3000 * MS
        world.advance(world.time + 10 * MS)
    assert world.time == pytest.approx(1100 * MS, rel=0.15)
    run(world, 1.0)
    assert 0.05 < part.current < 0.5  # holds the springs
    part.command_position(0.0)
    run(world, 2.0)
    np.testing.assert_allclose(part.joints(), 0.0, atol=0.02)


def test_mass_is_that_of_the_sheet() -> None:
    world = cell()
    assert world.model.body_subtreemass[world.model.body("hand/base").id] == pytest.approx(0.48, abs=0.005)


def test_fingers_that_touch_stop_while_the_others_go_on() -> None:
    before_the_index_finger = {"position": (0.03, 0.02645, 0.2)}
    block = {"part": "box", "size": (0.02, 0.012, 0.02), "at": before_the_index_finger}
    world = cell(block=block)
    part = hand(world)
    part.command_position(0.6 * CLOSED)
    run(world, 2.0)
    angles = dict(zip(part.labels, part.joints(), strict=True))
    bent = {
        finger: sum(angles[f"{finger}_{joint}"] for joint in ("inner", "middle", "outer"))
        for finger in ("index", "ring", "little")
    }
    assert bent["index"] < bent["ring"] - 0.3
    assert bent["ring"] == pytest.approx(bent["little"], abs=0.2)
    force = part.contact_force()
    assert force[1] > 0.3
    assert force[2] == force[3] == force[4] == 0.0


@pytest.mark.parametrize("pull", [(9.81, 0, 0), (0, 0, 9.81), (0, 0, -9.81), (0, 9.81, 0)])
def test_it_holds_a_bar_against_a_pull(pull: tuple[float, float, float]) -> None:
    world = cell(gravity=ONTO_THE_PALM, bar=bar(0.045, mass=0.5, free=True))
    part = hand(world)
    part.command_position(CLOSED)
    run(world, 2.0)
    assert part.position < 0.95 * CLOSED  # it doesn't get further
    assert part.current == pytest.approx(1.5, abs=0.1)  # the limit
    assert np.all(part.contact_force()[1:] > 0.0)
    assert 30.0 < part.contact_force().sum() < 90.0
    before = world.truth_arrays["bar_pose"][:3].copy()
    world.model.opt.gravity[:] = pull
    run(world, 1.0)
    assert np.linalg.norm(world.truth_arrays["bar_pose"][:3] - before) < 0.02


def test_a_lower_current_limit_holds_less() -> None:
    squeezed = []
    for limit in (0.5, 1.5):
        world = cell(bar=bar(0.045))
        part = hand(world)
        part.current_limit = limit
        assert part.current_limit == pytest.approx(limit)
        part.command_position(CLOSED)
        run(world, 2.5)
        assert part.current < limit + 0.01
        squeezed.append(part.contact_force().sum())
    assert squeezed[1] > 1.5 * squeezed[0]


def test_without_power_the_springs_open_it() -> None:
    world = cell()
    part = hand(world)
    assert part.commanded is None
    part.command_position(CLOSED)
    run(world, 2.0)
    part.command_position(None)
    run(world, 5.0)
    assert part.current == 0.0
    assert part.position < 0.6 * CLOSED


def test_it_works_on_an_arm() -> None:
    parts = {
        "arm": {"part": "panda", "declared_payload": {"mass": 0.48, "com": (0, 0, 0.1)}},
        "hand": {"part": "softhand", "at": "arm/flange"},
    }
    world = Cell(CellConfig.model_validate({"parts": parts}), 1)
    hand(world).command_position(CLOSED)
    run(world, 1.5)
    assert hand(world).position == pytest.approx(CLOSED, abs=0.03)
    assert world.truth_arrays["arm_external_effort"].max() < 0.5


def test_saved_world_goes_on_bit_for_bit() -> None:
    worlds = [cell(bar=bar(0.045)) for _ in range(2)]
    part = hand(worlds[0])
    part.current_limit = 1.0
    part.command_position(CLOSED)
    run(worlds[0], 0.8)
    worlds[1].restore(worlds[0].save())
    assert hand(worlds[1]).current == part.current
    for world in worlds:
        run(world, 0.5)
    assert np.array_equal(worlds[0].save(), worlds[1].save())
