"""What is said of samples that aren't taken, at the time that a machine has been up for days."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from srl.runtime.contracts.driver import Driver, Health
from srl.runtime.contracts.signals import Signal
from srl.runtime.ipc.header import DEVICE
from srl.runtime.loop.device import Device

DAYS = 10**15  # ns


class InDegrees:
    """A sensor whose every sample is beyond what can be."""

    name, max_age = "glove", 0.1
    stop_frames, frames_good_for = Driver.stop_frames, Driver.frames_good_for

    def __init__(self) -> None:
        self.states = (Signal(name="position", shape=(1,), unit="rad", labels=("index",), plausible=(-3.0, 3.0)),)
        self.state_arrays = {"position": np.zeros(1)}
        self.command_arrays, self.sent_arrays = dict[str, np.ndarray](), dict[str, np.ndarray]()
        self.health = Health(connected=True)

    def read(self, now: int) -> None:
        self.state_arrays["position"][:] = 90.0
        self.health.stamp = now


def test_a_sensor_that_is_wrong_from_the_start_is_said_to_be_so_from_then_on() -> None:
    reported: list[str] = []
    device = Device(cast(Any, InDegrees()), np.zeros(len(DEVICE), np.int64), [], reported.append)
    for k in range(500):
        device.read(DAYS + k * 10_000_000)
    assert reported[0] == "'glove': a sample isn't taken: position[index] 90 rad can't be: -3 to 3"
    assert "no sample has been taken for 4 s" in reported[-1]
    assert len(reported) == 4, "ever more rarely"
