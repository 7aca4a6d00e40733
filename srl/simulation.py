"""Base classes of simulated devices and worlds: fakes, twins, worlds, and parts of the composed world."""

from runtime.contracts.world import Fake, FakeConfig, Twin, World, WorldConfig
from runtime.control.hand.human_hand import JOINTS as HAND_JOINTS
from sim.parts.hand.human_hand import HumanHandPart
from sim.world.cell import Cell
from sim.world.mjcf import add
from sim.world.part import Mjcf, Part, PartConfig

__all__ = [
    "HAND_JOINTS",
    "Cell",
    "Fake",
    "FakeConfig",
    "HumanHandPart",
    "Mjcf",
    "Part",
    "PartConfig",
    "Twin",
    "World",
    "WorldConfig",
    "add",
]
