"""Things of the cell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.sim import MS
from pydantic import ValidationError

from srl.runtime.contracts.errors import WiringError
from srl.sim.parts.things.box import BoxConfig
from srl.sim.world.cell import Cell, CellConfig


def cell(**parts: dict[str, Any]) -> Cell:
    return Cell(CellConfig.model_validate({"floor": True, "parts": parts}), 1)


@pytest.mark.parametrize(
    ("shape", "size", "height"),
    [("box", (0.2, 0.2, 0.1), 0.05), ("sphere", (0.1,), 0.05), ("cylinder", (0.1, 0.2), 0.1)],
)
def test_a_free_thing_falls_on_the_floor(shape: str, size: tuple[float, ...], height: float) -> None:
    thing = {
        "part": "box",
        "shape": shape,
        "size": size,
        "mass": 2.0,
        "free": True,
        "at": {"position": (1, 2, height + 0.1)},
    }
    world = cell(thing=thing)
    assert np.all(world.truth_arrays["thing_contact_force"] == 0.0)
    world.advance(2000 * MS)
    np.testing.assert_allclose(world.truth_arrays["thing_pose"][:3], [1, 2, height], atol=2e-3)
    np.testing.assert_allclose(world.truth_arrays["thing_pose"][3:], [1, 0, 0, 0], atol=1e-3)
    np.testing.assert_allclose(world.truth_arrays["thing_contact_force"], [0, 0, 2.0 * 9.81], atol=0.1)


def test_friction_holds_it_on_a_slope_or_not() -> None:
    turned = {"quaternion": (np.cos(0.2), 0, np.sin(0.2), 0)}
    slope = {"part": "box", "size": (1.0, 0.4, 0.02), "at": {"position": (0, 0, 0.5)} | turned}
    block = {"part": "box", "size": (0.1, 0.1, 0.05), "free": True, "at": {"position": (0, 0, 0.54)} | turned}
    way = []
    for friction in (0.3, 0.6):  # tan(0.4) = 0.42
        world = cell(slope=slope | {"friction": 0.0}, block=block | {"friction": friction})
        world.advance(1000 * MS)
        way.append(world.truth_arrays["block_pose"][0])
    assert way[0] > 0.2
    assert abs(way[1]) < 0.02


def test_a_fixed_thing_stays() -> None:
    world = cell(shelf={"part": "box", "size": (0.5, 0.5, 0.02), "at": {"position": (0, 0, 1.0)}})
    world.advance(500 * MS)
    np.testing.assert_array_equal(world.truth_arrays["shelf_pose"], [0, 0, 1, 1, 0, 0, 0])


def test_one_that_can_not_be_touched_lets_others_through() -> None:
    ball = {"part": "box", "shape": "sphere", "size": (0.1,), "free": True, "at": {"position": (0, 0, 0.5)}}
    world = cell(
        ghost={"part": "box", "size": (1, 1, 0.1), "at": {"position": (0, 0, 0.2)}, "touches": False}, ball=ball
    )
    world.advance(1500 * MS)
    assert world.truth_arrays["ball_pose"][2] == pytest.approx(0.05, abs=2e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0.1, 0.1)}, "a box needs 3 positive"),
        ({"shape": "sphere", "size": (0.0,)}, "a sphere needs 1 positive"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        BoxConfig.model_validate(options)


def test_a_free_thing_can_not_be_mounted() -> None:
    thing = {"part": "box", "size": (0.1, 0.1, 0.1), "at": "arm/flange"}
    cell(arm={"part": "panda"}, thing=thing)
    with pytest.raises(WiringError, match=r"sim\.parts\.thing\.at: 'thing' moves freely, and can't be mounted"):
        cell(arm={"part": "panda"}, thing=thing | {"free": True})
