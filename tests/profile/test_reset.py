"""Which devices may have a button that resets: those whose buttons a person presses here."""

from __future__ import annotations

import pytest
from helpers.toy import Toy, wired

from srl.drivers.replay.driver import Replay
from srl.drivers.zenoh.driver import Zenoh
from srl.runtime.contracts.errors import WiringError
from srl.runtime.profile import profile, wiring


@pytest.mark.parametrize("driver", [Zenoh, Replay])
def test_what_comes_from_elsewhere_is_no_button(driver: type, monkeypatch: pytest.MonkeyPatch) -> None:
    """A client that publishes on the other machine's bus would release a person's stop as if it stood here."""
    more = "reset: {inputs: [{signal: panel.buttons, element: third}]}"
    assert wired(emergency="", more=more)
    monkeypatch.setattr(Toy, "here", driver.here)
    with pytest.raises(WiringError, match=r"reset\.inputs\.0.*no button that a person presses here.*another machine"):
        wired(emergency="", more=more)


def test_a_simulated_person_resets_no_real_limb() -> None:
    loaded = profile.load("sixth-finger", ["reset.inputs=[{signal: glove.position, element: thumb_roll}]"])
    assert wiring.build(*loaded, [])  # all simulated
    assert wiring.build(*loaded)
    with pytest.raises(WiringError, match="is simulated, and 'finger' is real"):
        wiring.build(*loaded, ["glove"])
