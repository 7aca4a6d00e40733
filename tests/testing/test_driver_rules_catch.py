"""Each rule for drivers is put to a device that breaks it, and says so; the device as it was written breaks none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest import SkipTest

import numpy as np
import pytest

from srl.drivers.firmata import Firmata
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.world import Fake, World
from srl.sim.devices.examples import CELL
from srl.sim.devices.firmata.fake import FakeFirmata, FakeFirmataConfig
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import DriverConformance, TwinBench, bound

RULES = [name for name in vars(DriverConformance) if name.startswith("test_")]


class Case(DriverConformance):
    """The rules for these classes, without a profile."""

    def __init__(self, driver: type[Driver], fake: type[Fake], twin: Any = None, **options: Any) -> None:
        self.classes, self.options = (driver, fake, twin), options

    def driver(self, port: str = "") -> Driver:
        cls = self.classes[0]
        return bound(cls("probe", cls.Config.model_validate({"port": port or self.nowhere} | self.options)))

    def simulated(self) -> tuple[World, Fake]:
        world, fake = Cell(CellConfig.model_validate({"parts": CELL["parts"]}), 1), self.classes[1]
        config = fake.Config.model_validate({"port": self.nowhere} | self.options)
        return world, bound(fake("probe", config, world, fake.Options()))

    def bench(self) -> TwinBench:
        if self.classes[2] is None:
            raise SkipTest("no twin")
        return TwinBench.of(self.classes[2](self.simulated()[1]))


def sensor(probe: SimpleNamespace, change: str) -> Case:
    """The written device with one thing wrong."""
    good, fake, twin = probe.driver.Probe, probe.fake.FakeProbe, probe.twin.ProbeTwin

    class BadDriver(good):  # type: ignore[misc, valid-type]
        if change == "no summary":
            summary = ""
        if change == "not in gives":
            gives = ("other",)
        if change == "no age":
            max_age = 0.0

        def __init__(self, name: str, config: Any) -> None:
            super().__init__(name, config)
            if change == "no names":
                self.states = (replace(self.states[0], labels=()),)
            if change == "connected before it is open":
                self.health.connected = True

        def open(self) -> None:
            if change == "bare error":
                raise DeviceError("it", "no", "no")
            if change == "opens nothing":
                self.health.opened()
                return
            if change == "another error":
                raise OSError("no such port")
            super().open()

        def close(self) -> None:
            if change == "can't be closed twice" and self._link is None:
                raise RuntimeError("it is closed")
            connected = self.health.connected
            super().close()
            if change == "connected before it is open":
                self.health.connected = connected

        def stop_frames(self, category: Any) -> Any:
            return [b"stop"] if change == "no frames" else super().stop_frames(category)

        def read(self, now: int) -> None:
            if change == "silent while closed" and self._link is None:
                return
            if change == "never lost":
                try:
                    super().read(now)
                except DeviceError:
                    return
            elif change == "raises on noise":
                bad = self.health.errors
                super().read(now)
                if self.health.errors > bad:
                    raise ValueError("a bad line")
            elif change == "counts no noise":
                super().read(now)
                self.health.errors = 0
            else:
                super().read(now)
            if change == "stamps each read":
                self.health.stamp = now
            if change == "no stamp":
                self.health.stamp = -1

    class BadFake(fake):  # type: ignore[misc, valid-type]
        if change == "fake of another age":
            max_age = 0.5

        def open(self) -> None:
            if change == "counts no reconnect":
                self.health.connected = True
            else:
                super().open()

        def read(self, now: int) -> None:
            if change == "fake read while closed":
                self.health.connected = True
            super().read(now)
            if change == "fake from the future":
                self.health.stamp = now + 1
            if change == "fake gives NaN":
                self.state_arrays["force"][1] = np.nan
            if change == "fake gives nothing":
                self.health.stamp = -1
            if change == "fake by chance":
                self.state_arrays["force"][:] = np.random.default_rng().random(3)

    class BadTwin(twin):  # type: ignore[misc, valid-type]
        def work(self, now: int) -> bytes:
            sent: bytes = super().work(now)
            return sent.replace(b",", b";", 1) if change == "twin of another protocol" else sent

    return Case(BadDriver, BadFake, BadTwin)


BUTTONS = {"servos": {"joint": {"pin": 9, "lower": -1.5, "upper": 1.5, "home": 0.0}}}


class Still(FakeFirmata):
    """A board whose servo turns nothing."""

    Options = FakeFirmataConfig

    def _mount(self, world: World) -> None:
        self._turns = ["joint"]

    def write(self, now: int) -> None:
        self._check()
        self.sent_arrays["position_command"][:] = self.command_arrays["position_command"]

    def stop(self, category: Any) -> None:
        pass

    def reset(self) -> None:
        pass

    def close(self) -> None:
        self.health.connected = False


def actuator(change: str) -> Case:
    class Board(Firmata):
        def __init__(self, name: str, config: Any) -> None:
            super().__init__(name, config)
            if change == "no period":
                self.commands = (replace(self.commands[0], period=None),)
            if change == "no stop":
                self.commands = (replace(self.commands[0], stops=()),)
            if change == "no home":
                self.home = {}

    class Simulated(Still):
        def write(self, now: int) -> None:
            if change == "fake replaces the array":
                self.sent_arrays = dict(self.command_arrays)
            elif change != "fake sends in silence":
                super().write(now)

    return Case(Board, Simulated, **BUTTONS)


SENSOR_FAULTS = [
    ("test_it_describes_itself", "no summary", "`srl list` wants"),
    ("test_it_declares_its_signals", "no names", "declares neither `labels` nor `slots`"),
    ("test_it_declares_its_signals", "no age", "`max_age` must say"),
    ("test_it_says_what_it_gives_and_takes", "not in gives", "`gives` lacks 'force'"),
    ("test_it_is_harmless_while_closed", "can't be closed twice", "it is closed"),
    ("test_it_is_harmless_while_closed", "connected before it is open", "says that it is connected"),
    ("test_it_is_harmless_while_closed", "no frames", "must give a tuple of bytes"),
    ("test_it_is_lost_while_closed", "silent while closed", "read must raise DeviceLostError"),
    ("test_nobody_there_is_an_error_with_place_and_remedy", "bare error", "lacks 'probe'"),
    ("test_nobody_there_is_an_error_with_place_and_remedy", "opens nothing", "must raise DeviceError"),
    ("test_nobody_there_is_an_error_with_place_and_remedy", "another error", "no such port"),
    ("test_the_fake_is_the_same_device", "fake of another age", "max_age isn't"),
    ("test_the_fakes_samples_are_fresh", "fake from the future", "before it was taken"),
    ("test_the_fakes_samples_are_fresh", "fake gives NaN", "isn't finite"),
    ("test_the_fakes_samples_are_fresh", "fake gives nothing", "gave no sample"),
    ("test_the_fake_repeats_exactly", "fake by chance", "other bits"),
    ("test_the_fake_can_be_closed_and_opened_again", "counts no reconnect", "`health.reconnects` is 0"),
    ("test_the_fake_can_be_closed_and_opened_again", "fake read while closed", "must raise DeviceLostError"),
    ("test_it_reads_its_twin", "twin of another protocol", "counts no frame of its twin"),
    ("test_it_reads_its_twin", "no stamp", "no `health.stamp`"),
    ("test_a_pulled_cable_is_a_loss", "never lost", "its port is gone"),
    ("test_a_hang_makes_its_samples_old", "stamps each read", "nothing came, and `health.stamp` went on"),
    ("test_noise_on_the_line_is_counted", "raises on noise", "a bad line"),
    ("test_noise_on_the_line_is_counted", "counts no noise", "counts it neither"),
]
ACTUATOR_FAULTS = [
    ("test_each_command_can_be_stopped", "no period", "declares no `period`"),
    ("test_each_command_can_be_stopped", "no stop", "`stops` is empty"),
    ("test_each_command_can_be_stopped", "no home", "needs a `home`"),
    ("test_the_fake_says_what_was_sent", "fake sends in silence", "doesn't say what left"),
    ("test_the_fake_says_what_was_sent", "fake replaces the array", "another array"),
]


def test_every_rule_is_broken_by_one_of_these() -> None:
    assert {rule for rule, _, _ in (*SENSOR_FAULTS, *ACTUATOR_FAULTS)} == set(RULES)


def put(rule: str, case: Case) -> Callable[[], None]:
    found: Callable[[], None] = getattr(case, rule)
    return found


@pytest.mark.parametrize("rule", RULES)
def test_what_was_written_keeps_it(rule: str, probe: SimpleNamespace) -> None:
    kept = 0
    for case in (sensor(probe, ""), actuator("")):
        try:
            put(rule, case)()
            kept += 1
        except SkipTest:
            pass
    assert kept


@pytest.mark.parametrize(("rule", "change", "words"), SENSOR_FAULTS)
def test_a_sensor_that_breaks_it_is_caught(rule: str, change: str, words: str, probe: SimpleNamespace) -> None:
    with pytest.raises(Exception, match=words):
        put(rule, sensor(probe, change))()


@pytest.mark.parametrize(("rule", "change", "words"), ACTUATOR_FAULTS)
def test_an_actuator_that_breaks_it_is_caught(rule: str, change: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        put(rule, actuator(change))()
