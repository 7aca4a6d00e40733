"""Which arm of a wearer a device is: what laws and clearances say of it must agree.

Were two arms' sides exchanged, each would be kept clear by the other one's places.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from srl.runtime.contracts.errors import WiringError
from srl.runtime.models.models import ArmsModel
from srl.runtime.models.skeleton.arms import SIDES, Side
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.graph import Cleared, Law
from srl.runtime.profile.names import Link


def compare(b: Builder, commands: Iterable[str], laws: Iterable[Law], made: Mapping[str, Cleared]) -> None:
    """Raises WiringError where a law says another side of a device than its clearance.

    Args:
        b: for places.
        commands: the names of all of them.
        laws: the controllers.
        made: the clearances, by command name.
    """
    limbs = {name.partition(".")[0] for name in commands}
    law_of = {(device, side): law.controller.name for law in laws for device, side in _sides(law, limbs)}
    for name, cleared in made.items():
        own = _side(cleared.clearance.config)
        for side in SIDES:
            law = law_of.get((name.partition(".")[0], side))
            if own is not None and law is not None and side != own:
                problem = f"'{name}' is the {own} arm here, and the {side} one in the law '{law}'"
                raise WiringError(b.source.place(f"guard.{name}.clear.side"), problem, "Say the same side in both")


def _sides(law: Law, limbs: set[str]) -> Iterator[tuple[str, Side]]:
    """The devices, of these, whose side a law says.

    It says so with an input that is named for a side; else with `side:`, which is that of the device that it commands,
    or, if it commands none, of those that it reads: what an arm follows may be the other one.
    """
    config = law.controller.config
    arms = getattr(config, "arms", None)
    if not isinstance(arms, ArmsModel):
        return
    named = [side for side in arms.arms.sides if side in law.inputs]
    for side in named:
        for far in law.inputs[side].far:
            yield far.partition(".")[0], side
    own = _side(config)
    if own is not None and not named:
        for device in _far(law.outputs, limbs) or _far(law.inputs, limbs):
            yield device, own


def _far(wires: Mapping[str, Link], limbs: set[str]) -> set[str]:
    return {far.partition(".")[0] for wire in wires.values() for far in wire.far} & limbs


def _side(config: Any) -> Side | None:
    """That of the arm that options are about; None where they are about none, or both."""
    arms = getattr(config, "arms", None)
    return arms.arms.side(config.side) if isinstance(arms, ArmsModel) and hasattr(config, "side") else None
