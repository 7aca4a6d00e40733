"""Supernumerary arms in the cell: the chain of servos stands and moves where the skeleton has it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from helpers.skeleton import human_srl
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.models.models import ArmsModel, context
from srl.runtime.models.skeleton.arms import BASE, SIDES, Side
from srl.sim.parts.body.motion import Scripted
from srl.sim.world.cell import Cell, CellConfig

KINDS = ("MX-106", "MX-106", "MX-64", "MX-64", "MX-64", "MX-28", "MX-28")
STILL = np.tile([1.0, 0.0, 0.0, 0.0], (59, 1))


def axes(**more: object) -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = {f"J{i + 1}": {"model": kind} for i, kind in enumerate(KINDS)}
    found["J5"] |= {"m_per_rad": 0.02}
    found["J1"] |= more
    return found


def cell(side: Side, **more: object) -> Cell:
    arms = ArmsModel(sides=SIDES)
    parts = {"arm": {"part": "dynamixel-chain", "arms": "srl-arms", "side": side, "axes": axes(**more)}}
    return Cell(CellConfig.model_validate({"parts": parts}, context=context({"srl-arms": arms})), 1)


CELLS = {side: cell(side) for side in SIDES}
KINEMATICS = Kinematics(human_srl())


@pytest.mark.parametrize("side", SIDES)
@given(q=st.lists(st.floats(-2.5, 2.5), min_size=7, max_size=7))
def test_the_chains_joints_are_the_skeletons_nodes(side: Side, q: list[float]) -> None:
    world, figure = CELLS[side], human_srl()
    tree, names = figure.tree, figure.arms.names(side)
    for name, value in zip(figure.arms.labels, q, strict=True):
        world.data.joint(f"arm/{name}").qpos = value
    mujoco.mj_kinematics(world.model, world.data)
    nodes = KINEMATICS.nodes(STILL, human().offsets[list(human().joints)], {side: np.array(q)})
    spine = nodes[tree.index("Spine")]
    # The sliding axis' body moves; the skeleton's node stays, and the next one moves.
    bodies = {"base": names[0], **{f"J{i}": names[i] for i in (1, 2, 3, 4, 6, 7)}, "tip": names[8]}
    for body, node in bodies.items():
        found = world.data.body(f"arm/{body}").xpos
        np.testing.assert_allclose(found, nodes[tree.index(node)] - spine, atol=1e-9, err_msg=body)


def test_what_the_arms_describe_cant_be_given_twice() -> None:
    with pytest.raises(ValidationError, match="J1: 'link' is described under `models:`"):
        cell("right", link=(0.1, 0.0, 0.0))
    with pytest.raises(ValidationError, match="J1 turns under `models:`"):
        cell("right", m_per_rad=0.02)


def _clear(base: tuple[float, float, float], q: np.ndarray) -> float:
    """m between the right arm's and the body's segments, thick as limbs, of somebody who stands at ease."""
    suit = Skeleton("axis-neuron")
    hips, turns = Scripted("still", suit, 1.0, 1, "wearer").at(1.0)
    offsets = suit.offsets.copy()
    offsets[0] = hips
    figure = HumanSrl(human(), ArmsModel(base=base).arms)
    nodes = Kinematics(figure).nodes(turns, offsets, {"right": q})
    radii = {
        **{("RightArm", "RightForeArm"): 0.05, ("RightForeArm", "RightHand"): 0.045},
        **{("RightHand", "RightHandMiddle3"): 0.045, ("Spine", "Spine3"): 0.14, ("Hips", "Spine1"): 0.14},
        **{("RightUpLeg", "RightLeg"): 0.085, ("RightLeg", "RightFoot"): 0.06},
    }
    share = np.linspace(0.0, 1.0, 25)[:, None]

    def points(a: str, b: str) -> np.ndarray:
        p, r = nodes[figure.tree.index(a)], nodes[figure.tree.index(b)]
        return p + share * (r - p)

    arm = np.concatenate([points("RJ3", "RJ4"), points("RJ4", "RJ6"), points("RJ6", "RJ7"), points("RJ7", "REnd")])
    gaps = [np.linalg.norm(arm[:, None] - points(*pair), axis=2).min() - radius for pair, radius in radii.items()]
    return float(min(gaps)) - 0.03


def test_the_mount_lets_a_hanging_forearm_pass() -> None:
    """Beside the hip the arm stands in the way of it; in front it doesn't, in the configurations of the profile."""
    two = np.deg2rad([-50.0, -50.0, -30.0, 0.0, 0.0, 0.0, 50.0])
    third = np.array([-0.6, -0.3, 0.4, -0.9, 0.08, -0.5, 0.2])
    assert min(_clear(BASE, q) for q in (np.zeros(7), two, third)) > 0.08
    assert _clear((-0.15, -0.05, 0.0), two) < 0.0
