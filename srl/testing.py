"""What tests of drivers, control laws, parts and profiles need. docs/testing.md shows it in use.

run = srl_run("plate.yaml")                                    # a fixture of the pytest plugin: a profile on its fakes
class TestPlate(DriverConformance): ...                        # all the rules for a driver, to derive from
driver = bound(Lever("lever", LeverConfig(port="loop://a")))   # arrays of its own, as the runtime gives them
check_driver(Lever("lever", LeverConfig(port="loop://b")))     # the rules that need no profile
run = simulate(PROFILE, seconds=5)                             # a whole profile, simulated, in this process

Nothing here needs pytest but the fixture.
"""

from srl.runtime.testing.bound import bound
from srl.runtime.testing.controller_conformance import ControllerConformance
from srl.runtime.testing.controller_rules import check_controller
from srl.runtime.testing.driver_conformance import DriverConformance
from srl.runtime.testing.driver_rules import check_driver
from srl.runtime.testing.lab import Lab
from srl.runtime.testing.part_conformance import PartConformance
from srl.runtime.testing.simulated import Simulated, simulate
from srl.runtime.testing.twin_bench import TwinBench

__all__ = [
    "ControllerConformance",
    "DriverConformance",
    "Lab",
    "PartConformance",
    "Simulated",
    "TwinBench",
    "bound",
    "check_controller",
    "check_driver",
    "simulate",
]
