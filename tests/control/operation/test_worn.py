"""Tip, Jacobians and distances of the worn arm against Pinocchio and against differences."""

import numpy as np
import pytest
from helpers.operation import DT, LOWER, UPPER, Hand, envelope
from helpers.skeleton import human_srl, tip
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.operation.worn import Worn
from srl.runtime.contracts.rotation import from_euler_xyz
from srl.runtime.contracts.signals import Array


def worn(person: Hand) -> Worn:
    made = Worn(human_srl(), "right", envelope())
    made.see(person.rotation, person.translation, 0.0)
    return made


@st.composite
def postures(draw: st.DrawFn) -> Array:
    return LOWER + np.array([draw(st.floats(0.02, 0.98)) for _ in range(7)]) * (UPPER - LOWER)


@given(postures(), st.floats(-3.0, 3.0))
@settings(max_examples=30)
def test_tip_is_pinocchios_wherever_the_wearer_stands(q: Array, turn: float) -> None:
    person = Hand()
    person.rotation[0] = from_euler_xyz(0.1, turn, 0.2)
    person.translation[0] += [1.0, 0.2, -3.0]
    assert worn(person).tip(q)[0] == pytest.approx(tip(q), abs=1e-9)


@given(postures())
@settings(max_examples=30)
def test_jacobian_is_the_derivative_of_the_tip(q: Array) -> None:
    arm = worn(Hand())
    J = arm.tip(q)[1].copy()
    for i, e in enumerate(np.eye(7)):
        after, before = arm.tip(q + 1e-6 * e)[0].copy(), arm.tip(q - 1e-6 * e)[0].copy()
        assert J[:, i] == pytest.approx((after - before) / 2e-6, abs=1e-7)


@given(postures())
@settings(max_examples=20)
def test_rows_are_the_derivatives_of_the_distances(q: Array) -> None:
    arm = worn(Hand())
    arm.tip(q)
    pairs = arm.pairs(10.0, 1000)
    assert len(pairs.distance) == len(arm.envelope.pairs)
    assert (np.diff(pairs.distance) >= 0.0).all()

    def distances(q: Array) -> Array:
        arm.tip(q)
        found = arm.pairs(10.0, 1000)
        back = np.empty(len(found.distance))
        back[found.indices] = found.distance
        return back[pairs.indices]

    for i, e in enumerate(np.eye(7)):
        slope = (distances(q + 1e-5 * e) - distances(q - 1e-5 * e)) / 2e-5
        # Where the nearest points jump (parallel axes), a distance has no derivative.
        assert np.quantile(np.abs(slope - pairs.rows[:, i]), 0.9) < 1e-3


def test_approach_is_the_rate_at_which_a_moving_hand_comes_nearer() -> None:
    person = Hand()
    start, way = np.array([1.0, 0.3, 0.6]), np.array([-0.01, 0.01, -0.01])
    person.bend(start)
    arm = worn(person)
    q = np.array([-0.9, -0.5, 0.0, -0.9, 0.05, -0.3, 0.0])
    arm.tip(q)
    wanted = [pair.name for pair in arm.envelope.pairs].index("RJ7-REnd/right_hand")
    seen = []
    for k in range(1, 12):
        person.bend(start + k * way)
        arm.see(person.rotation, person.translation, DT)
        arm.tip(q)
        pairs = arm.pairs(10.0, 1000)
        at = int(np.flatnonzero(pairs.indices == wanted)[0])
        seen.append((pairs.distance[at], pairs.approach[at]))
    distance, approach = np.array(seen).T
    rate = -(distance[-1] - distance[-6]) / (5 * DT)
    assert rate > 0.03
    # Both are means over some cycles, and the faster end of the hand counts.
    assert 0.7 * rate < approach[-1] < rate + 0.3


def test_walking_and_turning_are_no_approach() -> None:
    person = Hand()
    arm = worn(person)
    for k in range(1, 20):
        person.rotation[0] = from_euler_xyz(0.0, 0.05 * k, 0.0)
        person.translation[0] += [0.02, 0.0, 0.02]
        arm.see(person.rotation, person.translation, DT)
    arm.tip(np.zeros(7))
    assert np.abs(arm.pairs(10.0, 1000).approach).max() < 1e-9
