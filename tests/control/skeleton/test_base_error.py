"""What straps give: by how much links may be beside where they are said to be, and that the clearance keeps it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.reach.options import ReachConfig
from srl.control.reach.rest_margin import RestMargin
from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.control.skeleton.envelope import link_nodes
from srl.runtime.contracts.rotation import exp, matrix
from srl.runtime.contracts.signals import Command, Kind
from srl.runtime.models.models import ArmsModel

ARMS = ArmsModel(base=(-0.15, 0.05, 0.35))
COMMAND = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=tuple(f"J{i}" for i in range(1, 8)))
NAMES = tuple(f"J{i}" for i in range(1, 8))
LOW, HIGH = np.array([-1.6, -1.4, -1.6, -1.9, 0.0, -1.6, -2.6]), np.array([1.0, 0.3, 1.6, 1.9, 0.1, 1.6, 2.6])


@given(st.integers(0, 10_000), st.floats(0.0, 0.1), st.floats(0.0, 0.4))
@settings(max_examples=200, deadline=None)
def test_no_point_of_a_link_is_farther_beside_than_it_may_be(seed: int, shift: float, turn: float) -> None:
    rng = np.random.default_rng(seed)
    config = BodyClearanceConfig(arms=ARMS, least=0.02, uncertainty=0.0, base_shift=shift, base_turn=turn)
    axis = rng.normal(size=3)
    axis *= turn * rng.uniform() / np.linalg.norm(axis)
    R = np.array(matrix(exp(*axis.tolist())))
    aside = rng.normal(size=3)
    aside *= shift * rng.uniform() / np.linalg.norm(aside)
    nodes = link_nodes(config.arms.arms, config.arm, rng.uniform(LOW, HIGH)[None])[0]
    really = nodes[0] + (nodes - nodes[0]) @ R.T + aside
    off = np.linalg.norm(really - nodes, axis=1)
    assert (np.maximum(off[:-1], off[1:]) <= config.beside + 1e-9).all()


def clearance(**options: float) -> BodyClearance:
    config = BodyClearanceConfig(arms=ARMS, least=0.02, uncertainty=0.01, **options)
    return BodyClearance("guard.arm.position_command.clear", config, COMMAND)


def test_the_clearance_keeps_it_for_each_pair_and_from_the_other_arm() -> None:
    plain, strapped = clearance(), clearance(base_shift=0.02, base_turn=0.1)
    more = np.asarray(strapped._needed.uncertainty) - np.asarray(plain._needed.uncertainty)
    assert (more > 0.02).all()
    assert more == pytest.approx(strapped.options.beside[strapped._links])
    assert strapped.body.uncertainty == pytest.approx(0.01 + strapped.options.beside.max())
    assert more.max() > more.min(), "a link that is farther from the base is farther beside"


def test_reach_keeps_as_much() -> None:
    limits = {
        key: dict(zip(NAMES, values, strict=True))
        for key, values in (
            ("lower", LOW.tolist()), ("upper", HIGH.tolist()), ("velocity", [0.8] * 7), ("acceleration", [4.0] * 7),
        )
    }  # fmt: skip
    plain, strapped = (
        RestMargin(ReachConfig.model_validate({"arms": ARMS, **limits, **more}))
        for more in ({}, {"base_shift": 0.02, "base_turn": 0.1})
    )
    q = np.zeros((1, 7))
    assert strapped.margins(q)[0] < plain.margins(q)[0] - 0.02
