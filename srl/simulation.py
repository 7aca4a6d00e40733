"""Base classes of simulated devices and worlds: fakes, twins, worlds, and parts of the composed world."""

from srl.runtime.contracts.world import Fake, FakeConfig, Twin, World, WorldConfig
from srl.runtime.models.human_hand import JOINTS as HAND_JOINTS
from srl.sim.parts.hand.human_hand import HumanHandPart
from srl.sim.world.cell import Cell
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig

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
