"""The way from exposure to sending that a Motive tells: within a second, whatever its clocks say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.natnet import WANTED, motive, opened, step

from srl.sim.devices.natnet import twin_frame

MOST = 1_000_000_000  # ns
SPREAD = 15_000_000  # ns: the bench's step, the twin's delay and a frame's period


@pytest.mark.parametrize("usb", [False, True])
@pytest.mark.parametrize("off", [-1e15, -3600.0, -2.0, 0.5, 3600.0, 1e9])
def test_a_time_of_exposure_that_cannot_be_moves_the_stamp_by_no_more_than_a_second(
    usb: bool, off: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`off`: s from the true time of exposure; later than it was sent for a positive one."""
    config = WANTED | {"latency": 0.004}
    with motive(config, {"usb": usb}) as bench, opened(bench, config) as driver:
        step(bench, driver, 20)
        assert bench.now - driver.health.stamp < SPREAD
        made, ticks = twin_frame.frame, round(off * driver._frequency)

        def frame(seen: Any, *others: Any) -> bytes:
            moved = {name: getattr(seen, name) + ticks for name in ("exposed", "received") if getattr(seen, name)}
            return made(replace(seen, **{name: int(np.clip(v, 1, 2**63 - 1)) for name, v in moved.items()}), *others)

        monkeypatch.setattr(twin_frame, "frame", frame)
        for _ in range(5):
            step(bench, driver)
            assert bench.now - MOST - SPREAD <= driver.health.stamp <= bench.now
        monkeypatch.undo()
        step(bench, driver, 3)
        assert bench.now - driver.health.stamp < SPREAD
