"""Who begins: a worn arm waits for a person, a simulated one needn't."""

from __future__ import annotations

import pytest

from srl.runtime.profile import profile, wiring
from srl.runtime.service.arming import automatic


@pytest.mark.parametrize("name", ["human-srl", "human-srl-two", "human-srl-task"])
@pytest.mark.parametrize(("sim", "begins"), [(None, False), (["suit"], False), ([], True)])
def test_a_worn_arm_waits_unless_nothing_is_real(name: str, sim: list[str] | None, begins: bool) -> None:
    assert automatic(wiring.build(*profile.load(name), sim), True)[0] is begins


@pytest.mark.parametrize(("sim", "confirmed", "begins"), [(None, False, False), (None, True, True), ([], False, True)])
def test_a_limb_that_nothing_measures_waits_for_a_person_who_has_placed_it(
    sim: list[str] | None, confirmed: bool, begins: bool
) -> None:
    found, output = automatic(wiring.build(*profile.load("sixth-finger"), sim), confirmed)
    assert found is begins
    assert ("no position feedback" in output) is not begins


def test_a_device_that_is_named_twice_counts_once() -> None:
    graph = wiring.build(*profile.load("human-srl"), ["suit", "suit"])
    assert graph.simulated == ["suit"]
    assert not automatic(graph, True)[0], "the arm is real"


def test_a_simulation_waits_if_it_is_told_to() -> None:
    graph = wiring.build(*profile.load("human-srl", ["sim.start=manual"]), [])
    assert not automatic(graph, True)[0]
