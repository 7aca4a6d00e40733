"""The replay follows its path, waits for the body and goes on, and keeps limits and distances."""

import numpy as np
import pytest
from helpers.operation import ACCELERATION, DT, LOWER, SPEED, START, UPPER, Bench, Hand, circle
from hypothesis import given, settings
from hypothesis import strategies as st


def test_path_is_followed_within_a_millimetre_where_nothing_is_near() -> None:
    bench = Bench()
    bench.run(10.0)
    assert bench.replay.done
    assert bench.seconds < bench.path.duration + 0.5
    assert max(bench.errors) < 1e-3


@pytest.mark.slow
@given(st.integers(0, 200))
@settings(max_examples=8)
def test_limits_hold_on_the_way_to_any_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bench = Bench(path=circle(np.array([-0.3, 0.0, 0.5]) + rng.uniform(-0.2, 0.2, 3)), around="ignore")
    for _ in range(300):
        before, tip = bench.v.copy(), bench.tip.copy()
        bench.step()
        assert (np.abs(bench.v) <= SPEED + 1e-9).all()
        assert (np.abs(bench.v - before) <= ACCELERATION * DT + 1e-9).all()
        assert (bench.q >= LOWER - 1e-9).all()
        assert (bench.q <= UPPER + 1e-9).all()
        # Back to the path at a limited speed, beside that of the path itself.
        assert np.linalg.norm(bench.tip - tip) / DT < 1.1 * (bench.replay.options.catch_up + bench.path.fastest)


def test_tip_goes_back_to_the_path_at_a_limited_speed_and_only_then_on() -> None:
    bench = Bench()
    bench.run(2.0)
    s = bench.replay.s
    bench.q, bench.v = START + np.array([0.3, -0.2, 0.2, 0.3, 0.0, 0.2, 0.0]), np.zeros(7)
    bench.replay.r = 0.0
    tips = []
    for _ in range(100):
        bench.step()
        tips.append(bench.tip.copy())
        if bench.replay.error > bench.replay.options.wait:
            assert bench.replay.s == s
    assert np.linalg.norm(np.diff(tips, axis=0), axis=1).max() / DT < 1.2 * bench.replay.options.catch_up
    bench.run(15.0)
    assert bench.replay.done


@given(st.integers(0, 200))
@settings(max_examples=4)
def test_distance_to_a_body_at_rest_is_kept(seed: int) -> None:
    person = Hand()
    person.go(Bench().tip + np.random.default_rng(seed).uniform(-0.2, 0.2, 3))
    bench = Bench(person)
    keep = bench.replay.options.keep
    first = float(bench.worn.pairs(1.0, 12).distance.min())
    bench.run(7.0)
    # What was kept at the beginning stays kept; what was nearer doesn't come nearer.
    assert bench.least >= min(keep, first) - 2e-3


def crossing(bench: Bench) -> None:
    """The hand goes into the path's middle and away again."""
    share = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.clip((bench.seconds - 1.0) / 6.0, 0.0, 1.0)))
    middle = bench.path.points[len(bench.path.points) // 2]
    bench.person.go((1.0 - share) * np.array([-0.5, 0.3, 0.2]) + share * middle)


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("around", ["bend", "wait"])
def test_body_that_crosses_the_path_is_waited_for(around: str) -> None:
    bench, plain = Bench(around=around), Bench(around="ignore")
    for each in (bench, plain):
        while each.seconds < 25.0 and not each.replay.done:
            crossing(each)
            each.step()
        assert each.replay.done
    assert bench.seconds > plain.seconds + 1.0
    if around == "wait":
        assert max(bench.errors) < 5e-3


def test_phase_waits_while_the_measured_arm_is_held() -> None:
    bench = Bench()
    bench.run(2.0)
    s, held = bench.replay.s, bench.tip - [0.0, 0.08, 0.0]
    for _ in range(50):
        tip, J = bench.worn.tip(bench.q)
        bench.v = bench.replay.step(bench.q, bench.v, tip, J, held, bench.worn.pairs(0.2, 12), DT)
        bench.q = bench.q + DT * bench.v
    assert bench.replay.s == s
    assert bench.replay.r == 0.0


def test_arm_comes_to_rest_where_the_path_is_out_of_reach() -> None:
    bench = Bench(path=circle(np.array([-0.4, 0.1, 1.6])), around="ignore")
    for _ in range(1500):
        bench.step()
    assert np.abs(bench.v / SPEED).max() < 0.05
    assert bench.replay.s == 0.0
