"""What a person knows of the tool in the hand: how heavy it is, how it resists, where its weight pulls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from srl.runtime.contracts.rotation import Quaternion, Vector, conjugate, turned
from srl.sim.parts.person.config import PersonConfig
from srl.sim.world.robot_mjcf import SPECK

_HANDLE: Final = (6.0, 40.0, 1.0, 1.8)  # kg, N s/m, kg m^2, N m s/rad: the published admittance of a cobot's handle
_ZERO: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class KnownTool:
    """The tool as its person takes it to be.

    Attributes:
        mass, drag: kg and N s/m, by which the person plans forces.
        inertia, turn_drag: kg m^2 and N m s/rad, by which the person plans torques.
        weight: N, world axes, the force that holds what the hand carries or wears; it is felt, so it is exact.
        lever: m, hand's axes, centre of mass of what the hand carries.
    """

    mass: float
    drag: float
    inertia: float
    turn_drag: float
    weight: Vector = _ZERO
    lever: Vector = _ZERO


def known_tool(config: PersonConfig, model: Any, data: Any, hand: int, free: bool) -> KnownTool:
    """The tool at the body `hand`.

    Args:
        config: of the person.
        model: MuJoCo's.
        data: MuJoCo's, with positions and centres of mass computed.
        hand: number of the body.
        free: whether the hand stands in the world and holds a tool; otherwise it is at a robot's handle, of which the
            person knows the share `knowledge`.
    """
    total = float(model.body_subtreemass[hand])
    values = (total, 0.0, 0.0, 0.0) if free else _HANDLE
    learned = (config.learned_mass, config.learned_damping, config.learned_inertia, config.learned_turn_damping)
    share = 1.0 if free else config.knowledge
    mass, drag, inertia, turn_drag = (
        share * (value if own is None else own) for value, own in zip(values, learned, strict=True)
    )
    own = config.hand_mass if free else SPECK
    carried = total - own
    if carried <= 1e-9:
        return KnownTool(mass, drag, inertia, turn_drag)
    lever = (total * data.subtree_com[hand] - own * data.xpos[hand]) / carried - data.xpos[hand]
    turn: Quaternion = tuple(data.xquat[hand].tolist())
    return KnownTool(
        mass,
        drag,
        inertia,
        turn_drag,
        weight=tuple((-carried * model.opt.gravity).tolist()),
        lever=turned(conjugate(turn), tuple(lever.tolist())),
    )
