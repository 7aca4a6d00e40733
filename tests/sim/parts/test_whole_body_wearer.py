"""The part `body` with the script `actions`: its plan, what it is told, and a state that goes on bit for bit."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from srl.runtime.contracts.wearer import Hold, Perform, Rest, Walk
from srl.sim.parts.body.whole_body_wearer import ACTION
from srl.sim.world.cell import Cell, CellConfig

MS = 1_000_000
PAUSE = 2.0  # s


def cell(**options: object) -> Cell:
    part = {"part": "body", "script": "actions", **options}
    return Cell(CellConfig.model_validate({"timestep": 0.005, "parts": {"person": part}}), seed=1)


def hands(world: Cell) -> np.ndarray:
    """(2,) m, heights of the left and the right hand."""
    labels = world.truth[0].labels
    rows = [labels.index("LeftHand"), labels.index("RightHand")]
    return world.truth_arrays["person_position"][rows, 2].copy()


def test_the_plan_begins_with_both_hands_over_the_head_and_comes_back() -> None:
    world = cell(pause=PAUSE)
    world.advance(round(PAUSE * 1000) * MS)
    before = hands(world)
    world.advance(round((PAUSE + ACTION) * 1000) * MS)
    assert (hands(world) > before + 0.7).all()
    world.advance(round((2 * PAUSE + ACTION) * 1000) * MS)
    assert hands(world) == pytest.approx(before, abs=0.1)


def test_what_it_is_told_ends_the_plan() -> None:
    world = cell()
    assert world.wearer is not None
    world.wearer.instruct(Rest())
    world.advance(6000 * MS)
    still = hands(world)
    assert world.wearer.done
    world.wearer.instruct(Perform("wave"))
    assert not world.wearer.done
    world.advance(9000 * MS)
    assert world.wearer.done
    assert hands(world)[1] > still[1] + 0.5
    assert hands(world)[0] == pytest.approx(still[0], abs=0.1)
    with pytest.raises(ValueError, match="can't do Hold"):
        world.wearer.instruct(Hold((0.0, 0.0, 0.0)))


def test_a_saved_world_goes_on_bit_for_bit() -> None:
    world = cell(subject=2)
    assert world.wearer is not None
    world.advance(1000 * MS)
    world.wearer.instruct(Walk())
    world.advance(3000 * MS)
    state = world.save()
    world.advance(4000 * MS)
    first = world.save()
    world.wearer.instruct(Perform("squat"))
    world.advance(5000 * MS)
    world.restore(state)
    world.advance(4000 * MS)
    assert (world.save() == first).all()
    with pytest.raises(ValueError, match="instructions"):
        cell(subject=2).restore(state)


def test_other_scripts_have_no_wearer() -> None:
    assert cell(script="walk").wearer is None
    with pytest.raises(ValidationError):
        cell(script="dance")
