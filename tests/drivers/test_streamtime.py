"""Samples that carry no time."""

from __future__ import annotations

import numpy as np
import pytest

from srl.drivers.pause import WATCH
from srl.drivers.streamtime import ENDURED, Lateness, StreamTime, measured_rate
from srl.runtime.contracts.driver import Health
from srl.runtime.contracts.errors import DeviceLostError

MS = 1_000_000


def test_what_waited_is_old_and_what_was_lost_is_got_over() -> None:
    for lost in (0, 300):
        stream, now = StreamTime(100), 10**10
        count = 0
        for _ in range(500):
            count, now = count + 1, now + 10 * MS
            assert stream.stamp(count, now) == now
        now += 3_000 * MS
        waited = 300 - lost  # the samples of the pause: all waited, or all were lost
        for _ in range(waited):
            count += 1
            assert now - stream.stamp(count, now) >= (500 + waited - count) * 10 * MS - 2 * MS
        ages = []
        for _ in range(300):
            count, now = count + 1, now + 10 * MS
            ages.append(now - stream.stamp(count, now))
        assert (max(ages) < 2 * MS) == (lost == 0)
        assert max(ages[WATCH // (10 * MS) + 5 :]) < 2 * MS
        assert stream.restarts == (lost > 0)


def test_where_nothing_is_lost_unseen_a_lag_that_stays_is_a_queue() -> None:
    stream, now = StreamTime(100, learn=True, lossless=True), 10**10
    for count in range(6000):
        now += 10 * MS + (400 * MS if count == 500 else 0)
        age = now - stream.stamp(count, now)
        assert abs(age - (400 * MS if count >= 500 else 0)) < 15 * MS
        assert stream.delay == age
    assert stream.restarts == 0


def test_a_rate_known_roughly_is_learnt_and_never_makes_fresh_samples_stale() -> None:
    rng = np.random.default_rng(1)
    for truth, reported in ((120.3, 118.0), (59.7, 60.5)):
        stream = StreamTime(reported, learn=True)
        oldest = 0
        for k in range(round(120 * truth)):
            now = round(10**10 + k / truth * 1e9 + rng.exponential(2 * MS))
            oldest = max(oldest, now - stream.stamp(k, now))
        assert abs(stream.rate / truth - 1) < 5e-4
        assert oldest < 80 * MS
        assert stream.restarts == 0


@pytest.mark.parametrize("begins", np.linspace(-0.3, 0.4, 8))
def test_what_is_held_up_makes_no_measured_rate_too_high(begins: float) -> None:
    rng, counts = np.random.default_rng(1), range(31)
    for held in (0.0, 0.05, 0.3):
        comes = np.arange(31) / 60 + rng.exponential(0.001, 31)
        late = (comes > begins) & (comes < begins + held)
        comes[late] = begins + held + 1e-4 * np.arange(late.sum())
        rate = measured_rate(np.maximum.accumulate(comes).tolist(), counts)
        assert 5 < rate < 61


def test_no_rate_is_measured_of_less_than_two_samples_one_after_the_other() -> None:
    assert measured_rate([], []) == measured_rate([1.0], [5]) == 0.0
    assert measured_rate([1.0, 1.0], [5, 6]) == measured_rate([1.0, 2.0], [6, 5]) == 0.0
    assert measured_rate([1.0, 1.1, 1.1, 1.2], [5, 6, 5, 7]) == pytest.approx(10)


def test_frames_that_were_held_up_dont_tilt_the_rate() -> None:
    truth = 60.0
    for seed in range(5):
        rng = np.random.default_rng(seed)
        stream, free = StreamTime(60.4, learn=True), 0.18  # s: until then everything is held up
        oldest, pause = 0.0, rng.exponential(3.0)
        for k in range(round(100 * truth)):
            taken = k / truth
            if taken > pause:
                free, pause = taken + rng.uniform(0.1, 0.19), taken + 0.3 + rng.exponential(3.0)
            comes = max(taken + rng.exponential(0.002), free)
            stamp = stream.stamp(k, round((10 + comes) * 1e9))
            oldest = max(oldest, 10 + taken - stamp * 1e-9)
        assert abs(stream.rate / truth - 1) < 1e-3
        assert oldest < 0.05, "a sample was taken for older than it is"


@pytest.mark.parametrize("queue", [0.105, 0.15, 0.19])
def test_a_queue_that_stays_is_given_up_before_the_rate_takes_it_in(queue: float) -> None:
    """Later its samples would count as fresh: a smaller lag than 0.1 s can't be told from a rate that is a bit off."""
    clock, late, health = StreamTime(60.0, learn=True, lossless=True), Lateness(), Health()
    now = 0

    def take(k: int, lag: float) -> None:
        nonlocal now
        now = round((k / 60 + lag) * 1e9)
        assert abs(now - clock.stamp(k, now) - lag * 1e9) < 5 * MS
        late.check(clock.delay, now, "suit", health)

    for k in range(600):
        take(k, 0.0)
    with pytest.raises(DeviceLostError, match="late"):
        [take(k, queue) for k in range(600, 960)]
    assert now - 10_000 * MS < ENDURED + 500 * MS
