"""Base classes of simulated devices and worlds: fakes, twins, worlds, and parts of the composed world.

What needs MuJoCo is loaded when it is asked for: a file with a driver and its fake can be used without it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from srl.runtime.contracts.world import Fake, FakeConfig, Twin, World, WorldConfig
from srl.runtime.models.human_hand import JOINTS as HAND_JOINTS

if TYPE_CHECKING:
    from srl.sim.parts.hand.human_hand import HumanHandPart
    from srl.sim.world.cell import Cell
    from srl.sim.world.mjcf import add
    from srl.sim.world.part import Mjcf, Part, PartConfig

_FROM = {
    "Cell": "world.cell",
    "HumanHandPart": "parts.hand.human_hand",
    "Mjcf": "world.part",
    "Part": "world.part",
    "PartConfig": "world.part",
    "add": "world.mjcf",
}

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


def __getattr__(name: str) -> Any:
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"srl.sim.{_FROM[name]}"), name)
