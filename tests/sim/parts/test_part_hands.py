"""Hands that hold a thing: they turn it as told, never twice alike, and the world goes on from a saved state."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.person import cell
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Rest, Turn, Walk
from srl.sim.parts.person.hands import HandsPart
from srl.sim.parts.things.ft_sensor import FtSensorPart, HandlePart
from srl.sim.world.cell import Cell

SECOND = 1_000_000_000


def made() -> tuple[Cell, HandsPart]:
    world = cell(
        {
            "hands": (HandsPart, {}),
            "sensor": (FtSensorPart, {"at": "hands/held"}),
            "grip": (HandlePart, {"at": "sensor/tool", "mass": 0.4}),
        }
    )
    hands = world.parts["hands"]
    assert isinstance(hands, HandsPart)
    assert world.wearer is hands
    return world, hands


def turned(world: Cell, up: tuple[float, float, float], again: int = 0) -> Array:
    """(4,) how it is held 4 s after it was told."""
    assert world.wearer is not None
    world.wearer.instruct(Turn(up, again))
    assert not world.wearer.done
    world.advance(world.time + 4 * SECOND)
    assert world.wearer.done
    return world.truth_arrays["hands_turn"].copy()


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (2.0, 0.0, 0.0), (0.6, 0.6, -0.6)])
def test_what_is_held_is_turned_and_its_weight_shows(up: tuple[float, float, float]) -> None:
    world, _ = made()
    turn = Rotation.from_quat(turned(world, up), scalar_first=True)
    axis = turn.apply(np.array(up) / np.linalg.norm(up))
    assert axis[2] > np.cos(0.5)
    sensor = world.parts["sensor"]
    assert isinstance(sensor, FtSensorPart)
    expected = turn.inv().apply([0.0, 0.0, -9.81 * 0.45])
    np.testing.assert_allclose(sensor.wrench[:3], expected, atol=0.1)  # it sways


@pytest.mark.slow
def test_nobody_turns_a_thing_twice_alike_and_rest_holds_it() -> None:
    world, _ = made()
    first, second = turned(world, (0.0, 0.0, 1.0)), turned(world, (0.0, 0.0, 1.0), 1)
    assert abs(first @ second) < 0.999
    assert world.wearer is not None
    world.wearer.instruct(Rest())
    world.advance(world.time + SECOND)
    assert abs(second @ world.truth_arrays["hands_turn"]) > 0.9995
    with pytest.raises(ValueError, match="aren't told to Walk"):
        world.wearer.instruct(Walk())


@pytest.mark.slow
def test_a_restored_world_goes_on_bit_for_bit() -> None:
    world, hands = made()
    hands.instruct(Turn((1.0, 0.0, 0.0)))
    world.advance(SECOND)
    state = world.save()
    world.advance(3 * SECOND)
    after = world.truth_arrays["hands_turn"].copy()
    hands.instruct(Turn((0.0, 1.0, 0.0)))
    world.advance(4 * SECOND)
    world.restore(state)
    world.advance(3 * SECOND)
    assert (world.truth_arrays["hands_turn"] == after).all()
