"""The conformance tests of parts of the world `cell`: a class to derive from, in one's own tests.

class TestPlate(PartConformance):
    part, options = "force-plate", {"size": [0.4, 0.6]}
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from srl.runtime.contracts import registry
from srl.runtime.contracts.world import World
from srl.runtime.testing import part_rules

NAME = "tested"
_NONE: Mapping[str, Any] = MappingProxyType({})


class PartConformance:
    """Every rule for a part.

    Attributes:
        part: its registered name, as a profile writes it.
        options: its options, as a profile has them beside `part`.
        others: further parts by name, with their options; those that it stands on, or needs.
        world: further options of the cell.
    """

    part: str = ""
    options: Mapping[str, Any] = _NONE
    others: Mapping[str, Mapping[str, Any]] = _NONE
    world: Mapping[str, Any] = _NONE

    def made(self) -> World:
        """A new world with the part, called `tested`."""
        return self._world({NAME: {"part": self.part} | dict(self.options)})

    def without(self) -> World:
        """The same without it; a world needs something, so there is a box."""
        return self._world({})

    def _world(self, parts: Mapping[str, Any]) -> World:
        cls = registry.load("worlds", "cell", "test")
        there = {"other_thing": {"part": "box", "size": [0.1, 0.1, 0.1], "at": {"position": [9, 9, 9]}}}
        options = dict(self.world) | {"parts": dict(there) | dict(self.others) | dict(parts)}
        made: World = cls(cls.Config.model_validate(options), 3)
        return made

    def test_it_names_its_truth(self) -> None:
        part_rules.names_its_truth(self.made, NAME)

    def test_it_keeps_its_names_apart(self) -> None:
        part_rules.keeps_its_names_apart(self.made, self.without, NAME)

    def test_it_fills_its_truth(self) -> None:
        part_rules.fills_its_truth(self.made, NAME)

    def test_it_stays_finite(self) -> None:
        part_rules.stays_finite(self.made)

    def test_it_repeats_exactly(self) -> None:
        part_rules.repeats_exactly(self.made)

    def test_it_restores_exactly(self) -> None:
        part_rules.restores_exactly(self.made)
