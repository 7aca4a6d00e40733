"""Before the first cycle: what came from one device while another was opened isn't taken for fresh."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from runtime.contracts.driver import DeviceConfig, Driver
from runtime.contracts.signals import Stop
from runtime.contracts.world import Fake
from runtime.ipc.words import DEVICE, LINK_ERROR
from runtime.loop.device import Device
from runtime.loop.process import Process


class Counted(Driver):
    """A device whose full buffer is read in several goes; the newest sample comes last."""

    def __init__(self) -> None:
        super().__init__("ft", DeviceConfig())
        self.waiting = [f"old {k}" for k in range(5)]
        self.taken = ""
        self.health.connected = True

    def open(self) -> None: ...

    def read(self, now: int) -> None:
        assert abs(now - time.monotonic_ns()) < 60e9
        if self.waiting:
            self.taken = self.waiting.pop(0)

    def write(self, now: int) -> None: ...

    def stop(self, category: Stop) -> None: ...

    def close(self) -> None: ...

    def recover(self, now: int) -> None:
        raise ZeroDivisionError


class Simulated(Fake, Counted):
    """Its samples come from the world, which stands still until the first cycle."""

    __init__ = Counted.__init__
    open, read, write, stop, close = Counted.open, Counted.read, Counted.write, Counted.stop, Counted.close


def device(driver: Any, events: list[str]) -> Device:
    return Device(driver, np.zeros(len(DEVICE), np.int64), [], events.append)


def test_what_waited_while_others_were_opened_is_read_before_the_first_cycle() -> None:
    process = Process.__new__(Process)
    real, simulated = Counted(), Simulated()
    process.devices = [device(real, []), device(simulated, [])]
    process._catch_up()
    assert real.waiting == []
    assert len(simulated.waiting) == 5


def test_a_recovery_that_failed_is_over_once_the_device_is_well() -> None:
    """Else the driver's error would stand for ever, as `recover` is only called while there is a fault."""
    events: list[str] = []
    driver = Counted()
    made = device(driver, events)
    driver.health.fault = "reflex"
    made.read(time.monotonic_ns())
    made.recover(0)
    made.read(time.monotonic_ns())
    assert int(made.words[DEVICE.link]) & LINK_ERROR
    assert any("failed to recover" in event for event in events)
    driver.health.fault = ""
    made.read(time.monotonic_ns())
    assert not int(made.words[DEVICE.link]) & LINK_ERROR
