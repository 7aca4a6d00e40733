"""What every part of the world `cell` must do: one rule a function. Each raises AssertionError with what is wrong.

A rule takes what makes a new world with the part in it, and the part's name there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.world import World

TIMES = tuple(range(5_000_000, 500_000_001, 5_000_000))  # ns
UNTOUCHED = 1e300  # in every element of the truth, before the first advance

Make = Callable[[], World]


def names_its_truth(make: Make, part: str) -> None:
    """Its true values are called `<part>_...`, and each element has a name."""
    world = make()
    for signal in _truth(world, part):
        assert not (fault := signal.naming_fault()), f"{signal.name}: {fault}"
    world.close()


def keeps_its_names_apart(make: Make, others: Make, part: str) -> None:
    """What it adds to the model, and to the truth, begins with its own name, so that two of them fit into one world.

    Args:
        make: a world with the part.
        others: the same world without it.
    """
    world, without = make(), others()
    added = {s.name for s in world.truth} - {s.name for s in without.truth}
    for name in sorted(added):
        assert name.startswith(f"{part}_"), f"the truth '{name}' of part '{part}' must begin with '{part}_'"
    for name in sorted(_names(world) - _names(without)):
        own = name == part or name.startswith(f"{part}/")
        assert own, f"'{name}' in the model is of part '{part}', and must begin with '{part}/'"
    world.close()
    without.close()


def fills_its_truth(make: Make, part: str) -> None:
    """Every element of its truth is written in each advance."""
    world = _bound(make())
    for now in TIMES[:2]:
        world.advance(now)
        for signal in _truth(world, part):
            values = world.truth_arrays[signal.name]
            assert not (values == UNTOUCHED).any(), f"{signal.name} wasn't filled after {now * 1e-9:g} s"
            values.fill(UNTOUCHED)
    world.close()


def stays_finite(make: Make) -> None:
    """The world's physics stays in order for half a second, with nobody at the controls."""
    world = _bound(make())
    data = getattr(world, "data", None)
    for now in TIMES:
        world.advance(now)
        if data is not None:
            head = f"after {now * 1e-9:g} s: MuJoCo"
            finite = np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
            assert finite, f"{head} has positions or velocities that aren't finite"
            # MuJoCo begins anew by itself at a state that isn't finite, and counts a warning.
            count = sum(warning.number for warning in data.warning)
            assert count == 0, f"{head} warned {count} times (a state that blows up, too many contacts)"
    world.close()


def repeats_exactly(make: Make) -> None:
    """Two worlds with the same seed give the same bits."""
    one, other = _run(make()), _run(make())
    assert one == other, "a second world with the same seed gives other bits: a clock, or a chance that isn't seeded"


def restores_exactly(make: Make) -> None:
    """From a state that was saved the world continues bit for bit: `save` has all that the part remembers."""
    world = _bound(make())
    middle = len(TIMES) // 2
    for now in TIMES[:middle]:
        world.advance(now)
    saved = world.save().copy()
    first = _bits(world, TIMES[middle:])
    world.restore(saved)
    again = _bits(world, TIMES[middle:])
    assert first == again, "after `restore` the world goes on in another way: `save` lacks something"
    world.close()


def _truth(world: World, part: str) -> list[Signal]:
    return [s for s in world.truth if s.name.startswith(f"{part}_")]


def _bound(world: World) -> World:
    world.bind({s.name: np.full(s.shape, UNTOUCHED) for s in world.truth})
    return world


def _names(world: World) -> set[str]:
    """All names in the compiled model."""
    model = getattr(world, "model", None)
    packed: bytes = model.names if model is not None else b""
    return {name.decode() for name in packed.split(b"\0") if name}


def _run(world: World) -> list[bytes]:
    made = _bits(_bound(world), TIMES)
    world.close()
    return made


def _bits(world: World, times: tuple[int, ...]) -> list[bytes]:
    made = []
    for now in times:
        world.advance(now)
        made.append(world.save().tobytes() + b"".join(v.tobytes() for v in world.truth_arrays.values()))
    return made
