"""The conformance tests of drivers: a class to derive from, in one's own tests.

class TestPlate(DriverConformance):
    profile, device = "plate.yaml", "plate"

The profile says all that is needed: the driver, its options, the fake's, and the world. pytest runs each method
`test_...` of the class; a rule that doesn't concern this device is skipped.
"""

from __future__ import annotations

import json
from unittest import SkipTest

from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.world import Fake, World
from srl.runtime.profile import wiring
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source
from srl.runtime.testing import driver_rules, fake_rules, twin_rules
from srl.runtime.testing.bound import bound
from srl.runtime.testing.given import Given, driver_of, read
from srl.runtime.testing.twin_bench import TwinBench


class DriverConformance:
    """Every rule for a driver and its fake, put to one device of a profile.

    Attributes:
        profile: a path, the name of a profile that comes with srl, YAML text, or its keys.
        device: its name there.
        nowhere: a port on which nobody answers.
        only_changes: the device tells what has changed and nothing else, as a keyboard: its silence says nothing.
    """

    profile: Given = ""
    device: str = ""
    nowhere: str = "/dev/srl-nobody"
    only_changes: bool = False

    # -- what is tested; a class may make them in another way

    def driver(self, port: str = "") -> Driver:
        """A new driver with the profile's options, bound, at this port or `nowhere`."""
        checked, source = self._read()
        cls = source.load("drivers", driver_of(checked, source, self.device), f"devices.{self.device}.driver")
        if "port" in cls.Config.model_fields:
            checked, source = self._read(f"devices.{self.device}.port={json.dumps(port or self.nowhere)}")
        return self._of(wiring.build(checked, source, None))

    def simulated(self) -> tuple[World, Fake]:
        """A new world, and in it the fake, bound."""
        graph = wiring.build(*self._read(), [])
        fake = self._of(graph)
        assert graph.world is not None
        assert isinstance(fake, Fake)
        return graph.world, fake

    def bench(self) -> TwinBench:
        """The twin in a world of its own."""
        if driver_of(*self._read(), self.device) not in registry.names("twins"):
            raise SkipTest("the device has no twin")
        return TwinBench(self.profile, self.device)

    def _read(self, *overrides: str) -> tuple[Profile, Source]:
        if not self.profile or not self.device:
            problem = "it doesn't say what is tested"
            raise RequestError(
                type(self).__name__, problem, "Set its `profile` and its `device`, as docs/testing.md shows"
            )
        return read(self.profile, overrides)

    def _of(self, graph: Graph) -> Driver:
        driver_of(graph.profile, graph.source, self.device)
        return bound(next(each for each in graph.devices if each.name == self.device))

    # -- the driver

    def test_it_describes_itself(self) -> None:
        driver_rules.describes_itself(self.driver())

    def test_it_declares_its_signals(self) -> None:
        driver_rules.declares_signals(self.driver())

    def test_it_says_what_it_gives_and_takes(self) -> None:
        driver_rules.says_what_it_gives_and_takes(self.driver())

    def test_each_command_can_be_stopped(self) -> None:
        self._moves(self.driver())
        driver_rules.can_be_stopped(self.driver())

    def test_it_is_harmless_while_closed(self) -> None:
        driver_rules.is_harmless_while_closed(self.driver())

    def test_it_is_lost_while_closed(self) -> None:
        driver_rules.is_lost_while_closed(self.driver())

    def test_nobody_there_is_an_error_with_place_and_remedy(self) -> None:
        driver = self.driver()
        if "port" not in type(driver).Config.model_fields:
            raise SkipTest("the driver has no port")
        driver_rules.says_who_is_missing(driver)

    # -- the fake

    def test_the_fake_is_the_same_device(self) -> None:
        fake_rules.is_the_same_device(self.simulated()[1], self.driver())

    def test_the_fakes_samples_are_fresh(self) -> None:
        fake_rules.samples_are_fresh(self.simulated)

    def test_the_fake_repeats_exactly(self) -> None:
        fake_rules.repeats_exactly(self.simulated)

    def test_the_fake_can_be_closed_and_opened_again(self) -> None:
        fake_rules.can_be_closed_and_opened_again(self.simulated)

    def test_the_fake_says_what_was_sent(self) -> None:
        self._moves(self.driver())
        fake_rules.says_what_was_sent(self.simulated)

    # -- the driver in front of its twin

    def test_it_reads_its_twin(self) -> None:
        twin_rules.reads_its_twin(self.bench(), self.driver)

    def test_a_pulled_cable_is_a_loss(self) -> None:
        twin_rules.a_pulled_cable_is_a_loss(self.bench(), self.driver)

    def test_a_hang_makes_its_samples_old(self) -> None:
        if self.only_changes:
            raise SkipTest("the device tells only changes")
        twin_rules.a_hang_makes_samples_old(self.bench(), self.driver)

    def test_noise_on_the_line_is_counted(self) -> None:
        twin_rules.noise_is_counted(self.bench(), self.driver)

    def _moves(self, driver: Driver) -> None:
        if not driver.commands:
            raise SkipTest("the device takes no commands")
