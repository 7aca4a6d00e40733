"""Two emergency inputs with different stops: the one that comes first in the profile counts, whichever was first."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import pytest
from helpers.toy import BUTTONS, Bench

from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc.header import Cause
from srl.runtime.loop.machine import Fault, Machine
from srl.runtime.profile.profile import EmergencyInput, Faults

INPUTS = [
    EmergencyInput(signal="panel.buttons", element=name, category=category)
    for name, category in zip(BUTTONS, (Stop.LIMP, Stop.HOLD, Stop.DAMP), strict=False)
]


@pytest.mark.parametrize("pressed", [p for n in (1, 2, 3) for p in permutations(range(3), n)], ids=str)
@pytest.mark.parametrize("before", ["active", "ready", "stopped"])
def test_the_first_of_the_profile_counts_in_whatever_order_they_are_pressed(
    pressed: tuple[int, ...], before: str
) -> None:
    m = Machine(Faults(), INPUTS, automatic=before != "ready")
    m.start_if_ready(None)
    m.settle(True)
    if before == "stopped":
        m.stop(Fault(Cause.REQUEST))
        m.settle(True)
    for k, fault_source in enumerate(pressed):
        m.stop(Fault(Cause.EMERGENCY, fault_source))
        first = min(pressed[: k + 1])
        assert (m.cause, m.fault_source, m.override) == (Cause.EMERGENCY, first, INPUTS[first].category)
        m.settle(False)
    for fault_source in pressed:  # they stay pressed
        m.stop(Fault(Cause.EMERGENCY, fault_source))
    assert (m.fault_source, m.override) == (min(pressed), INPUTS[min(pressed)].category)


@pytest.mark.parametrize(("earlier", "later"), [(0, 1), (1, 0)])
def test_in_a_run_the_stop_of_the_first_stays_when_that_is_released(tmp_path: Path, earlier: int, later: int) -> None:
    """`first` holds the joints, `second` lets them go."""
    inputs = ", ".join(
        f"{{signal: panel.buttons, element: {name}, category: {category}}}"
        for name, category in (("first", "hold"), ("second", "limp"))
    )
    b = Bench(tmp_path, emergency=inputs)
    seen: list[tuple[int, Stop | None]] = []

    def script(k: int) -> None:
        seen.append((b.cycle.machine.fault_source, b.cycle.machine.override))
        b.hand.values["position"][:] = 1.5
        b.panel.values["buttons"][earlier] = k >= 40
        if k >= 45:
            b.panel.values["buttons"][later] = 1
        if k >= 60:
            b.panel.values["buttons"][0] = 0

    b.run(80, script)
    assert seen[41:46] == ([(0, Stop.HOLD)] if earlier == 0 else [(1, Stop.LIMP)]) * 5
    assert set(seen[46:]) == {(0, Stop.HOLD)}
    assert set(b.header("cause")[40:-1].tolist()) == {Cause.EMERGENCY}
