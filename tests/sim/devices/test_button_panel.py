"""A board with four buttons and no servos: the panel beside a handle, in a world without a hand."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.peer import Peer, bound, cycles

from srl.drivers.firmata import Firmata
from srl.drivers.firmata.config import FirmataConfig
from srl.runtime.contracts.errors import WiringError
from srl.sim.devices.firmata.fake import FakeFirmata, FakeFirmataConfig
from srl.sim.world.cell import Cell, CellConfig

BUTTONS = {name: {"pin": 2 + i} for i, name in enumerate(("admittance", "mode", "gripper", "priority"))}
PRESSES = {"admittance": [[0.3, 0.5]], "mode": [[0.4, 0.405]], "gripper": [[0.6, 1.5]], "priority": [[0.7, 0.9]]}
WORLD = {"world": "cell", "parts": {"thing": {"part": "box", "size": [0.1, 0.1, 0.1]}}}


def test_the_fake_needs_no_hand() -> None:
    world = Cell(CellConfig.model_validate({"parts": WORLD["parts"]}), 0)
    options = FakeFirmataConfig.model_validate({"presses": PRESSES})
    panel = bound(FakeFirmata("panel", FirmataConfig.model_validate({"port": "x", "buttons": BUTTONS}), world, options))
    panel.open()
    assert panel.commands == ()
    seen = []
    for ms in range(0, 1200, 5):
        world.advance(ms * 1_000_000)
        panel.read(ms * 1_000_000)
        seen.append(panel.state_arrays["buttons"].copy())
    edges = np.diff(np.array(seen), axis=0)
    assert (edges > 0).sum(axis=0).tolist() == [1, 0, 1, 1]  # 5 ms of `mode` is a bounce
    assert (edges < 0).sum(axis=0).tolist() == [1, 0, 0, 1]


@pytest.mark.slow
def test_driver_and_twin_over_a_pty() -> None:
    with Peer("firmata", {"buttons": BUTTONS}, {"presses": {"gripper": [[1.0, 60.0]]}}, WORLD) as peer:
        panel = bound(Firmata("panel", FirmataConfig.model_validate({"port": peer.address, "buttons": BUTTONS})))
        panel.open()
        seen: list[list[float]] = []
        for _ in range(20):
            cycles(panel, 0.25, 100, lambda now: seen.append(panel.state_arrays["buttons"].tolist()))
            if seen[-1][2]:
                break
        assert seen[-1] == [0, 0, 1, 0]
        panel.close()


def test_a_press_of_a_button_it_hasnt_is_refused() -> None:
    world = Cell(CellConfig.model_validate({"parts": WORLD["parts"]}), 0)
    with pytest.raises(WiringError, match="has no button 'grip'"):
        FakeFirmata(
            "panel",
            FirmataConfig.model_validate({"port": "x", "buttons": BUTTONS}),
            world,
            FakeFirmataConfig.model_validate({"presses": {"grip": [[0, 1]]}}),
        )
