"""A velocity that isn't that of its position is found soon; one that is, late or a little off, never is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from helpers.compiled import bits, needs_c
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.compiled import undone
from srl.runtime.contracts.signals import Array
from srl.runtime.guard.rates import RateCheck

WAYS = [pytest.param(True, marks=needs_c), False]  # in C, in Python
RATES = [20, 100, 1000]  # Hz


class Joints:
    """Some joints whose velocities are judged."""

    def __init__(self, in_c: bool = True, size: int = 2, unit: str = "rad/s") -> None:
        self.q, self.w = np.zeros(size), np.zeros(size)
        self.check = RateCheck(self.q, self.w, unit)
        if not in_c:
            self.check._step = undone

    def sample(self, q: float | Array, w: float | Array, dt: float) -> int:
        """Of joint one; the others stand."""
        self.q[0], self.w[0] = np.broadcast_to(q, 1)[0], np.broadcast_to(w, 1)[0]
        return self.check.step(dt)

    def run(self, seconds: float, dt: float, speed: float, tell: Callable[[float], float]) -> list[int]:
        """Joint one goes on at a speed, and tells another; what was found in each sample."""
        found = []
        for _ in range(round(seconds / dt)):
            found.append(self.sample(self.q[0] + speed * dt, tell(speed), dt))
        return found


def right(speed: float) -> float:
    return speed


sines = st.lists(
    st.tuples(st.floats(0.05, 1.0), st.floats(0.05, 3.0), st.floats(0, 6.28)),  # share, Hz, phase
    min_size=1,
    max_size=4,
)


@pytest.mark.parametrize("rate", RATES)
@settings(max_examples=15)
@given(sines, st.floats(0.1, 3.0), st.floats(0.0, 0.02), st.floats(0.95, 1.05))
def test_a_velocity_that_is_filtered_and_a_little_off_is_never_wrong(
    rate: int, parts: list[tuple[float, float, float]], top: float, lag: float, scale: float
) -> None:
    t = np.arange(round(3.0 * rate)) / rate
    q, w = np.zeros(t.size), np.zeros(t.size)
    whole = sum(share for share, _, _ in parts)
    for share, hertz, phase in parts:
        speed, turn = top * share / whole, 2 * np.pi * hertz
        q += speed / turn * np.sin(turn * t + phase)
        w += scale * speed / np.hypot(1.0, turn * lag) * np.cos(turn * t + phase - np.arctan(turn * lag))
    joints = Joints()
    for here, output in zip(q.tolist(), w.tolist(), strict=True):
        assert joints.sample(here, output, 1 / rate) == -1


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("stuck", [0.5, -0.5, 3.0, -100.0])
def test_a_velocity_that_is_stuck_while_the_joint_stands_is_found(in_c: bool, rate: int, stuck: float) -> None:
    joints = Joints(in_c)
    assert set(joints.run(1.0, 1 / rate, 0.0, right)) == {-1}
    assert 0 in joints.run(0.3, 1 / rate, 0.0, lambda speed: stuck)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("before", [0.5, 1.0])
def test_a_velocity_that_sticks_in_motion_is_found_once_the_joint_stands(rate: int, before: float) -> None:
    joints = Joints()
    assert set(joints.run(1.0, 1 / rate, before, right)) == {-1}
    assert 0 in joints.run(0.3, 1 / rate, 0.0, lambda speed: before)


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("speed", [1.0, -1.0, 3.0, 10.0])
def test_a_velocity_of_the_wrong_sign_is_found(in_c: bool, rate: int, speed: float) -> None:
    joints = Joints(in_c)
    assert set(joints.run(1.0, 1 / rate, speed, right)) == {-1}
    assert 0 in joints.run(0.3, 1 / rate, speed, lambda v: -v)


def test_it_is_the_joint_that_is_wrong_which_is_named() -> None:
    joints = Joints(size=3)
    joints.w[2] = 2.0
    found = [joints.check.step(0.01) for _ in range(30)]
    assert set(found) == {-1, 2}


def test_of_a_joint_that_slides_less_is_believed() -> None:
    turns, slides = Joints(), Joints(unit="m/s")
    assert set(turns.run(1.0, 0.01, 0.0, lambda speed: 0.08)) == {-1}
    assert 0 in slides.run(0.3, 0.01, 0.0, lambda speed: 0.08)


@pytest.mark.parametrize("rate", RATES)
@settings(max_examples=15)
@given(st.floats(-1000, 1000), st.floats(-3, 3), st.floats(0.02, 2.0), st.floats(-3, 3))
def test_what_was_wrong_and_is_right_again_is_soon_taken(
    rate: int, wrong: float, speed: float, seconds: float, later: float
) -> None:
    joints = Joints()
    joints.run(0.5, 1 / rate, speed, right)
    joints.run(seconds, 1 / rate, speed, lambda _: wrong)
    joints.run(1.5, 1 / rate, later, right)
    assert set(joints.run(0.5, 1 / rate, later, right)) == {-1}


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("gap", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("what", ["position", "velocity", "both"])
def test_what_was_not_known_for_a_while_is_no_way_that_was_made_in_one_period(
    in_c: bool, rate: int, gap: float, what: str
) -> None:
    joints, q, dt = Joints(in_c), 0.0, 1 / rate
    found = []
    for k in range(rate):
        q += 3.0 * dt
        away = 0.5 <= k * dt < 0.5 + gap
        found.append(
            joints.sample(
                np.nan if away and what != "velocity" else q, np.nan if away and what != "position" else 3.0, dt
            )
        )
    assert set(found) == {-1}


def test_what_was_not_known_for_a_while_hides_no_wrong_velocity() -> None:
    joints, found = Joints(), []
    for k in range(60):
        found.append(joints.sample(0.0, np.nan if k % 3 == 0 else 2.0, 0.01))
    assert 0 in found[:45]


numbers = st.floats(-3, 3) | st.sampled_from((np.nan, np.inf, -np.inf, 0.0, -0.0, 1e300, -1e300, 1e-310, 1000.0))
series = st.lists(
    st.tuples(*[numbers] * 6, st.sampled_from((0.001, 0.01, 0.05, 0.0, 0.6))), min_size=1, max_size=30
)  # fmt: skip


@needs_c
@settings(max_examples=80)
@given(series, st.integers(-1, 29))
def test_c_finds_what_python_finds(rows: list[tuple[float, ...]], restarted: int) -> None:
    both = Joints(True, 3), Joints(False, 3)
    for k, (*values, dt) in enumerate(rows):
        found = []
        for joints in both:
            if k == restarted:
                joints.check.restart()
            joints.q[:], joints.w[:] = values[:3], values[3:]
            found.append(joints.check.step(dt))
        assert found[0] == found[1]
        assert bits(both[0].check._state) == bits(both[1].check._state)


@needs_c
@pytest.mark.parametrize("seed", range(4))
def test_c_finds_what_python_finds_of_a_motion_that_goes_wrong_for_a_while(seed: int) -> None:
    random, both, wrong = np.random.default_rng(seed), (Joints(True, 4), Joints(False, 4)), 0
    q, w = np.zeros(4), np.zeros(4)
    for _ in range(500):
        dt = float(random.choice((0.002, 0.01, 0.05)))
        w += random.normal(0.0, 0.3, 4)
        q += w * dt
        output = np.where(random.random(4) < 0.1, random.choice((np.nan, 0.0, 30.0), 4), w)
        found = []
        for joints in both:
            joints.q[:], joints.w[:] = q, output
            found.append(joints.check.step(dt))
        wrong += found[0] >= 0
        assert found[0] == found[1]
        assert bits(both[0].check._state) == bits(both[1].check._state)
    assert 0 < wrong < 500
