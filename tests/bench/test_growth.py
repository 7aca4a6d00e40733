"""The profiles of the bench `growth` are as large as it says, and a limb that isn't moved is no figure."""

from __future__ import annotations

import pytest

from bench import growth
from srl.runtime.ipc.header import Cause
from srl.runtime.loop.machine import Fault
from srl.runtime.profile import profile, wiring


@pytest.mark.parametrize(("limbs", "servos"), [(1, 1), (max(growth.LIMBS), growth.EACH), (1, max(growth.SERVOS))])
def test_a_profile_is_as_large_as_it_says(limbs: int, servos: int) -> None:
    graph = wiring.build(*profile.parse("growth", growth.text(limbs, servos)))
    assert [a.command.shape for a in graph.actuators] == [(servos,)] * limbs
    assert len({a.device for a in graph.actuators}) == limbs


@pytest.mark.slow
def test_every_limb_moves_at_its_bus_and_one_that_stops_is_an_error() -> None:
    with growth._system(2, 1) as system:
        before = system.commanded
        growth._block({1: system})
        assert system.commanded > before
        system._cycle.machine.stop(Fault(Cause.REQUEST))
        with pytest.raises(RuntimeError, match="2 limbs have stopped"):
            growth._block({1: system})
