"""A device's counter on the loop's clock."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.devicetime import DRIFT, DeviceTime

TICK = 10_000_000


def test_a_late_sample_keeps_its_age() -> None:
    clock = DeviceTime(TICK)
    for k in range(100):
        assert clock.stamp(k, 1_000 + k * TICK) == 1_000 + k * TICK
    now = 1_000 + 99 * TICK + 3_000_000_000
    stamp = clock.stamp(100, now)
    assert abs(stamp - (1_000 + 100 * TICK)) <= 3_000_000_000 * DRIFT
    assert clock.delay >= 2_980_000_000


@given(st.lists(st.integers(0, 50_000_000), min_size=1, max_size=300), st.integers(1, 2**40))
def test_stamps_are_never_in_the_future_and_differ_from_the_truth_by_the_shortest_delay(
    delays: list[int], start: int
) -> None:
    clock = DeviceTime(TICK)
    arrived = 0
    least = 10**12
    for k, delay in enumerate(delays):
        arrived = max(arrived, start + k * TICK + delay)  # a link keeps the order
        stamp = clock.stamp(k, arrived)
        least = min(least, arrived - start - k * TICK)
        assert stamp <= arrived
        assert start + k * TICK <= stamp + 1
        assert stamp - start - k * TICK <= least + (k + 1) * (TICK + 50_000_000) * DRIFT


def test_a_counter_wraps() -> None:
    clock = DeviceTime(TICK, bits=8)
    for k in range(1000):
        assert clock.stamp(k % 256, k * TICK) == k * TICK
    assert clock.restarts == 0


def test_a_counter_that_starts_again_is_a_restart() -> None:
    clock = DeviceTime(TICK)
    clock.stamp(5000, 10**12)
    assert clock.stamp(3, 10**12 + TICK) == 10**12 + TICK
    assert clock.restarts == 1


def test_a_datagram_that_was_overtaken_is_no_restart() -> None:
    clock = DeviceTime(TICK)
    clock.stamp(10, 10**9)
    clock.stamp(11, 10**9 + TICK)
    assert clock.stamp(10, 10**9 + TICK) == 10**9
    assert clock.restarts == 0


def test_the_clocks_may_drift() -> None:
    clock = DeviceTime(TICK)
    for k in range(100_000):  # the device's clock is 100 ppm slow, for 1000 s
        now = k * TICK + k * 1000
        assert 0 <= now - clock.stamp(k, now) <= 2000
