"""What may be an emergency input: what a device measures or a client sends, whatever state the limb is in."""

from __future__ import annotations

import pytest
from helpers.toy import wired

from srl.runtime.contracts.errors import WiringError
from srl.runtime.profile import profile, wiring


@pytest.mark.parametrize("signal", ["arm.command", "arm.command.applied", "arm.command.sent"])
def test_what_is_computed_is_no_emergency_input(signal: str) -> None:
    """Laws rest in a stop: a switch that is read through one could neither hinder a reset nor be let go."""
    with pytest.raises(WiringError, match=r"emergency\.0.*no device or client says"):
        wired(emergency=f"{{signal: {signal}, element: elbow}}")


def test_the_simulations_truth_is_no_emergency_input() -> None:
    """The same profile would have none on the real limb; and a replay has it rounded."""
    stop = "{signal: world.finger_position, element: abduction}"
    with pytest.raises(WiringError, match=r"emergency\.0.*no device or client says"):
        wiring.build(*profile.load("sixth-finger", [f"emergency=[{stop}]"]), [])


def test_a_client_may_send_one() -> None:
    assert wired(emergency="{signal: client.position, element: elbow}", client=True)
