"""The cell's parts `wall` and `push`: stiffness in N/m, a cart's momentum, what they give, what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.errors import WiringError
from srl.sim.world.cell import Cell, CellConfig

G = 9.81
MASS = 2.0


def cell(**options: Any) -> Cell:
    """A box that falls 2 cm onto a horizontal wall."""
    parts = {
        "thing": {"part": "box", "size": [0.1, 0.1, 0.1], "mass": MASS, "free": True, "at": {"position": [0, 0, 1]}},
        "wall": {"part": "wall", "touches": "thing/body", "normal": [0, 0, 2], "gap": 0.02} | options,
    }
    return Cell(CellConfig.model_validate({"parts": parts}), seed=1)


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5])
def test_what_rests_on_it_goes_in_by_its_weight_over_its_stiffness(stiffness: float) -> None:
    world = cell(stiffness=stiffness, damping=0.5 * np.sqrt(stiffness * MASS))
    world.advance(3_000_000_000)
    np.testing.assert_allclose(world.truth_arrays["wall_force"], [0, 0, MASS * G], rtol=1e-3, atol=1e-9)
    assert 1.0 - 0.02 - world.truth_arrays["thing_pose"][2] == pytest.approx(MASS * G / stiffness, rel=1e-3)


def test_without_damping_it_returns_what_it_took_and_never_pulls() -> None:
    world = cell(stiffness=1e4, damping=0.0)
    heights, forces = [], []
    for k in range(1, 400):
        world.advance(k * 1_000_000)
        heights.append(world.truth_arrays["thing_pose"][2])
        forces.append(world.truth_arrays["wall_force"][2])
    assert max(heights[120:]) == pytest.approx(1.0, abs=1e-3)
    assert min(forces) == 0.0 < max(forces)


def test_a_cart_takes_the_momentum_and_rolls_out_by_its_resistance() -> None:
    world = cell(mass=10.0, stiffness=1e4, damping=0.0)
    world.advance(200_000_000)
    way, speed = world.truth_arrays["wall_moved"]
    assert way < 0.0 > speed
    assert MASS * (world.data.qvel[2] + 0.2 * G) == pytest.approx(10.0 * -speed, rel=0.02)
    stopped = cell(mass=10.0, resistance=2.0 * MASS * G)
    stopped.advance(3_000_000_000)
    assert stopped.truth_arrays["wall_moved"][1] == 0.0


def test_a_saved_world_goes_on_alike() -> None:
    world, other = cell(mass=10.0, damping=5.0), cell(mass=10.0, damping=5.0)
    world.advance(150_000_000)
    other.restore(world.save())
    for each in (world, other):
        each.advance(300_000_000)
    np.testing.assert_array_equal(world.data.qpos, other.data.qpos)
    np.testing.assert_array_equal(world.truth_arrays["wall_moved"], other.truth_arrays["wall_moved"])


def test_what_it_refuses() -> None:
    with pytest.raises(WiringError, match=r"no body is called 'thing/bodi'.*thing/body"):
        cell(touches="thing/bodi")
    with pytest.raises(ValueError, match="the normal needs a length"):
        cell(normal=[0, 0, 0])


def test_what_a_wall_gave_is_the_energy_that_the_body_has_gained() -> None:
    for damping, back in ((0.0, 0.0), (40.0, -0.1)):
        world = cell(stiffness=1e4, damping=damping)
        works = []
        for k in range(1, 150):  # it falls, is in the wall, and has left it
            world.advance(k * 1_000_000)
            works.append(float(world.truth_arrays["wall_work"][0]))
            if min(works) < -0.3 and world.truth_arrays["wall_force"][2] == 0.0:
                break
        height, speed = world.truth_arrays["thing_pose"][2], float(world.data.qvel[2])
        assert world.truth_arrays["wall_force"][2] == 0.0 < speed
        gained = 0.5 * MASS * speed**2 + MASS * G * (height - 1.0)
        assert works[-1] == pytest.approx(gained, abs=0.01)  # 0.4 J have fallen
        assert min(works) < -0.3
        assert works[-1] <= back + 0.01


def test_a_push_gives_its_force_for_its_time() -> None:
    parts = {
        "thing": {"part": "box", "size": [0.1, 0.1, 0.1], "mass": MASS, "free": True, "at": {"position": [0, 0, 9]}},
        "knock": {"part": "push", "pushes": "thing/body", "force": [0, 50.0, 0], "times": [[0.1, 0.3]], "rise": 0.05},
    }
    world = Cell(CellConfig.model_validate({"parts": parts}), seed=1)
    world.advance(90_000_000)
    assert world.truth_arrays["knock_force"] == pytest.approx([0, 0, 0])
    world.advance(200_000_000)
    assert world.truth_arrays["knock_force"] == pytest.approx([0, 50, 0])
    world.advance(400_000_000)
    speed = float(world.data.qvel[1])
    assert speed == pytest.approx(50.0 * 0.15 / MASS, rel=0.01)  # the impulse, N s, over the mass
    assert world.truth_arrays["knock_work"][0] == pytest.approx(0.5 * MASS * speed**2, rel=0.01)


def test_a_push_at_a_body_that_is_not_there_is_refused() -> None:
    parts = {"knock": {"part": "push", "pushes": "arm/tip", "force": [0, 50.0, 0], "times": [[0.1, 0.3]]}}
    with pytest.raises(WiringError, match="no body is called 'arm/tip'"):
        Cell(CellConfig.model_validate({"parts": parts}), seed=1)
