"""Before the first cycle: what waited isn't taken for fresh, and a request to end is never lost."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.signals import Stop
from srl.runtime.contracts.world import Fake
from srl.runtime.ipc.header import DEVICE, LINK_ERROR
from srl.runtime.ipc.launch import Launch
from srl.runtime.loop import process as process_module
from srl.runtime.loop.device import Device
from srl.runtime.loop.process import Process


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
    assert int(made.header[DEVICE.link]) & LINK_ERROR
    assert any("failed to recover" in event for event in events)
    driver.health.fault = ""
    made.read(time.monotonic_ns())
    assert not int(made.header[DEVICE.link]) & LINK_ERROR


class Asked:
    """An `Ending` of the test's own."""

    def __init__(self) -> None:
        self.asked = False
        self.on_ask: Callable[[], None] = lambda: None

    def ask(self) -> None:
        self.asked = True
        self.on_ask()


class Opened(Counted):
    """Tells when it is opened and closed."""

    def __init__(self, name: str, log: list[str], ask: Callable[[], None] = lambda: None) -> None:
        super().__init__()
        self.name, self.log, self.ask = name, log, ask

    def open(self) -> None:
        self.log.append(f"open {self.name}")
        try:
            self.ask()  # in the middle of what takes long
        except Exception:  # as a driver may do
            pass

    def close(self) -> None:
        self.log.append(f"close {self.name}")


def starting(monkeypatch: pytest.MonkeyPatch, devices: list[Opened], ending: Asked) -> Process:
    """A process whose profile has these devices."""
    graph = SimpleNamespace(
        warnings=[], remarks=[], devices=devices,
        row=SimpleNamespace(devices=np.zeros((9, len(DEVICE)), np.int64)), world=None,
        actuators_of=lambda _: [],
    )  # fmt: skip
    monkeypatch.setattr(process_module.profile, "parse", lambda *_: (None, None))
    monkeypatch.setattr(process_module.wiring, "build", lambda *_: graph)
    process = Process.__new__(Process)
    process.launch, process.ending = Launch("", ""), cast(Any, ending)
    return process


def test_a_request_to_end_breaks_off_an_opening_and_closes_what_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    log: list[str] = []
    ending = Asked()
    devices = [Opened("a", log), Opened("b", log, ending.ask), Opened("c", log)]
    starting(monkeypatch, devices, ending).run()
    assert log == ["open a", "open b", "close a", "close b", "close c"]
    ending.ask()  # once more: nothing left to break off


def test_a_request_from_before_the_first_instruction_opens_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    log: list[str] = []
    ending = Asked()
    ending.asked = True
    starting(monkeypatch, [Opened("a", log)], ending).run()
    assert log == ["close a"]


def test_a_request_between_opening_and_the_loop_is_one_to_the_loop() -> None:
    process = Process.__new__(Process)
    ending = Asked()
    process.ending = cast(Any, ending)
    requests = SimpleNamespace(end_asked=False)
    process._end_safely(cast(Any, requests))
    assert not requests.end_asked
    ending.ask()
    assert requests.end_asked
    late = SimpleNamespace(end_asked=False)
    process._end_safely(cast(Any, late))
    assert late.end_asked


def test_closing_a_device_ends_its_idle_thread() -> None:
    made = device(Counted(), [])
    made.watch()
    made.close()
    assert made._reopener is not None
    assert not made._reopener.is_alive()


def test_a_driver_that_fails_to_give_its_stop_frame_or_its_descriptor_ends_no_loop() -> None:
    class Defective(Counted):
        def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
            raise ZeroDivisionError

        def fileno(self) -> int | None:
            raise ZeroDivisionError

    events: list[str] = []
    found = device(Defective(), events)
    assert found.stop_frames(Stop.HOLD, 0) is None
    assert found.fileno(0) is None
    assert ["failed to give its" in event for event in events] == [True, True]
    found.read(time.monotonic_ns())
    assert found.header[DEVICE.link] & LINK_ERROR
