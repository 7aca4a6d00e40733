"""Samples that are missing, that come late or slowly: what came back is soon taken, and no single one is believed."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.guard.samples import AGREE, SLACK, SPEED, SampleCheck

FAST = 2.0  # rad/s
JOINTS = ("one", "two")
POSITION = Signal(name="position", shape=(2,), unit="rad", labels=JOINTS)
VELOCITY = Signal(name="velocity", shape=(2,), unit="rad/s", labels=JOINTS)
RATES = [20, 50, 100, 1000]  # Hz


class Arm:
    """Two joints, commanded to FAST at most, that are sampled at a rate; the loop runs `cycles` times as fast."""

    def __init__(self, rate: int = 100, cycles: int = 1, compared: bool = False, apart: bool = False) -> None:
        signals = (POSITION, VELOCITY)
        row = np.zeros(9)
        parts = {"position": row[:2], "velocity": row[6:8] if apart else row[2:4]}
        self.arrays: dict[str, Array] = parts
        self.check = SampleCheck(signals, parts)
        self.check.expect("position", np.full(2, FAST))
        if compared:
            self.check.compare("position", "velocity")
        self.dt, self.cycles, self.now = 1 / rate, cycles, 0

    def at(self, one: float, two: float = 0.0, speed: float = 0.0) -> bool:
        """A sample, and the cycles until the next one."""
        stamp = self.now + round(self.dt * 1e9)
        for k in range(self.cycles):
            self.now = stamp + round(k * self.dt * 1e9 / self.cycles)
            if k == 0 or self.check.odd is None:
                self.arrays["position"][:], self.arrays["velocity"][:] = (one, two), (speed, 0.0)
            taken = self.check.take(stamp, self.now)
            if k == 0:
                first = taken
            assert taken == first, "in the cycles between two samples nothing is decided anew"
        self.now = stamp
        return first

    def silent(self, seconds: float) -> None:
        """No new sample comes."""
        for _ in range(round(seconds / self.dt)):
            self.now += round(self.dt * 1e9)
            self.check.take(self.check._seen, self.now)

    @property
    def place(self) -> list[float]:
        return [float(v) for v in self.arrays["position"]]


# -- what isn't known for a while


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("gap", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("speed", [FAST, -FAST])
@pytest.mark.parametrize("compared", [False, True], ids=["alone", "compared"])
@pytest.mark.parametrize("cycles", [1, 3])
def test_a_joint_in_motion_that_isn_t_known_for_a_while_comes_back(
    rate: int, gap: float, speed: float, compared: bool, cycles: int
) -> None:
    arm, q, missing = Arm(rate, cycles, compared), 0.0, round(gap * rate)
    for _ in range(max(AGREE, rate // 5)):
        q += speed * arm.dt
        assert arm.at(q, speed=speed)
    for _ in range(missing):
        q += speed * arm.dt
        assert arm.at(np.nan, speed=np.nan)
    taken = []
    for _ in range(max(AGREE, rate // 5)):
        q += speed * arm.dt
        taken.append(arm.at(q, speed=speed))
        assert not arm.check.jumped
    assert all(taken[AGREE - 1 :]), f"refused {taken.count(False)} of {len(taken)}: {arm.check.last}"
    assert arm.place[0] == q


@given(st.sampled_from(RATES), st.floats(0.05, 0.2), st.floats(-FAST, FAST), st.booleans())
def test_two_joints_of_which_one_isn_t_known_for_a_while(rate: int, gap: float, speed: float, both: bool) -> None:
    arm, q, back = Arm(rate), 0.0, 10 + round(gap * rate)
    for k in range(back + 10):
        q += speed * arm.dt
        away = 10 <= k < back
        taken = arm.at(np.nan if away else q, np.nan if away and both else -q)
        assert not arm.check.jumped
        assert taken or back <= k < back + AGREE - 1


# -- the first samples


@pytest.mark.parametrize("wrong", [2.0, -3.0, 500.0])
@pytest.mark.parametrize("unknown", [3, 4, 30])
def test_a_wrong_value_that_comes_first_after_what_isn_t_known_is_never_shown(wrong: float, unknown: int) -> None:
    arm = Arm()
    for _ in range(unknown):
        arm.at(np.nan)
        assert np.isnan(arm.place[0])
    arm.at(wrong)
    assert np.isnan(arm.place[0])
    for k in range(1, 6):
        arm.at(0.1)
        assert np.isnan(arm.place[0]) if k < AGREE else arm.place[0] == 0.1
        assert arm.check.settled == (k >= AGREE)


@pytest.mark.parametrize("wrong", [2.0, -3.0, 500.0])
@pytest.mark.parametrize("unknown", [2, 3, 30])
def test_a_wrong_value_before_what_isn_t_known_agrees_with_nothing(wrong: float, unknown: int) -> None:
    arm = Arm()
    arm.at(wrong)
    assert not arm.check.settled
    for _ in range(unknown):
        arm.at(np.nan)
        assert np.isnan(arm.place[0])
    for k in range(1, 6):
        arm.at(0.1)
        assert np.isnan(arm.place[0]) if k < AGREE else arm.place[0] == 0.1
        assert arm.check.settled == (k >= AGREE)


@given(st.lists(st.sampled_from(("right", "right", "wrong", "unknown")), max_size=12))
def test_no_wrong_value_is_shown_and_settled(kinds: list[str]) -> None:
    """Each wrong one is elsewhere, so no two agree."""
    arm = Arm()
    for k, kind in enumerate([*kinds, "right", "right", "right", "right"]):
        taken = arm.at({"right": 0.1, "wrong": 2.0 + 7.0 * k, "unknown": np.nan}[kind])
        if arm.check.settled and taken:
            assert arm.place[0] == 0.1 or np.isnan(arm.place[0])
    assert arm.check.settled
    assert arm.place[0] == 0.1


# -- after a pause

BOUND = {rate: SLACK["rad"] + SPEED * FAST * 3 / rate for rate in RATES}


def _after_absurd_ones(arm: Arm, count: int) -> None:
    """Each refused, and none agrees with the one before."""
    for k in range(count):
        assert not arm.at(1e6 if k % 3 == 2 else (-1) ** k * (50.0 + 3.0 * k))


@pytest.mark.parametrize("rate", RATES)
@settings(max_examples=25)
@given(st.integers(1, 50), st.floats(0.001, 3.0), st.sampled_from((-1, 1)))
def test_after_absurd_samples_one_far_away_isn_t_taken_and_three_are(
    rate: int, count: int, beyond: float, side: int
) -> None:
    arm, far = Arm(rate), side * (BOUND[rate] + beyond)
    for _ in range(5):
        arm.at(0.0)
    _after_absurd_ones(arm, count)
    assert not arm.at(far)
    assert arm.place == [0.0, 0.0]
    assert [arm.at(far) for _ in range(AGREE - 1)] == [False] * (AGREE - 2) + [True]
    assert arm.place == [far, 0.0]
    assert arm.at(far)


@pytest.mark.parametrize("rate", RATES)
@settings(max_examples=25)
@given(st.integers(1, 50), st.floats(0.001, 3.0), st.sampled_from((-1, 1)))
def test_after_a_silence_one_far_away_isn_t_taken_and_three_are(
    rate: int, count: int, beyond: float, side: int
) -> None:
    arm, far = Arm(rate), side * (BOUND[rate] + beyond)
    for _ in range(5):
        arm.at(0.0)
    arm.silent(count / rate)
    assert not arm.at(far)
    assert arm.place == [0.0, 0.0]
    assert [arm.at(far) for _ in range(AGREE - 1)][-1]
    assert arm.place == [far, 0.0]


@pytest.mark.parametrize("rate", RATES)
def test_after_absurd_samples_the_place_before_is_taken_at_once(rate: int) -> None:
    arm = Arm(rate)
    for _ in range(5):
        arm.at(0.0)
    _after_absurd_ones(arm, 20)
    assert arm.at(0.01)
    assert not arm.check.jumped


# -- a hand that pushes


def _pushed(rate: int, push: float, top: float, start: float) -> list[float]:
    """Where a limp joint is: at rest, pushed up to a speed, moved on, braked as hard as it was pushed."""
    up = top / push
    ends = np.cumsum([0.3 + start / rate, up, 0.3, up, 0.3])
    t = np.arange(0.0, ends[-1], 1 / 4000)
    speed = np.interp(t, [0.0, *ends], [0.0, 0.0, top, top, 0.0, 0.0])
    return (np.cumsum(speed) / 4000)[:: 4000 // rate].tolist()


@pytest.mark.parametrize("rate", [20, 50, 100])
@settings(max_examples=30)
@given(st.floats(60, 400), st.floats(5, 10), st.floats(0, 1), st.sampled_from((-1, 1)))
def test_a_hand_that_pushes_a_limp_joint_is_no_jump(
    rate: int, push: float, top: float, start: float, side: int
) -> None:
    arm, taken = Arm(rate), []
    for q in _pushed(rate, push, top, start):
        taken.append(arm.at(side * q))
        assert not arm.check.jumped, arm.check.last
    longest = max((len(list(group)) for right, group in groupby(taken) if not right), default=0)
    assert longest / rate <= 0.2
    assert taken[-1]


# -- of what isn't taken, nothing is


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("cycles", [1, 3])
@pytest.mark.parametrize("wrong", ["position", "velocity"])
def test_of_a_sample_that_isn_t_taken_nothing_is_in_any_array(apart: bool, cycles: int, wrong: str) -> None:
    arm = Arm(cycles=cycles, apart=apart)
    for _ in range(5):
        arm.at(0.1, speed=0.5)
    assert len(arm.check._pieces) == 1 + apart
    assert not (arm.at(0.11, speed=1e7) if wrong == "velocity" else arm.at(3.0, speed=0.7))
    assert arm.place == [0.1, 0.0]
    assert arm.arrays["velocity"].tolist() == [0.5, 0.0]


def test_of_a_sample_that_isn_t_taken_no_position_is_where_the_next_may_go_on_from() -> None:
    """Each small step is possible, and each is of a sample that is refused for its velocity."""
    arm, step = Arm(apart=True), 0.03
    for _ in range(5):
        arm.at(0.0)
    for k in range(1, 11):
        assert not arm.at(k * step, speed=1e7)
        assert arm.place == [0.0, 0.0]
    assert not arm.at(-10 * step)
    assert arm.at(0.0)


# -- what a device says of its own range


def _state(unit: str) -> tuple[SampleCheck, Array]:
    signal = Signal(name="a", shape=(2,), unit=unit)
    array = np.zeros(2)
    return SampleCheck((signal,), {"a": array}), array


def _give(check: SampleCheck, array: Array, k: int, *values: float) -> bool:
    array[:] = values
    return check.take(k * 10_000_000, k * 10_000_000)


def test_a_range_of_what_is_no_force_is_only_a_range() -> None:
    """A key may be pressed for one sample."""
    check, array = _state("1")
    check.narrow("a", np.zeros(2), np.ones(2))
    for k in range(1, 10):
        assert _give(check, array, k, 0.0, 0.0)
    assert _give(check, array, 10, 1.0, 0.0)
    assert array.tolist() == [1.0, 0.0]
    assert _give(check, array, 11, 0.0, 1.0)
    assert array.tolist() == [0.0, 1.0]
    assert not _give(check, array, 12, 1.1, 0.0)
    assert array.tolist() == [0.0, 1.0]
    assert check.odd is not None
    assert "0 to 1" in check.odd.why


@pytest.mark.parametrize("unit", ["N", "N m"])
def test_a_force_that_jumps_is_taken_once_three_samples_say_so(unit: str) -> None:
    check, array = _state(unit)
    check.narrow("a", np.full(2, -40.0), np.full(2, 40.0))
    for k in range(1, 10):
        assert _give(check, array, k, 0.0, 0.0)
    assert _give(check, array, 10, 9.9, 0.0)
    assert _give(check, array, 11, 0.0, 0.0)
    assert not _give(check, array, 12, 10.1, 0.0)
    assert _give(check, array, 13, 0.0, 0.0)
    assert [_give(check, array, k, 20.0, 0.0) for k in range(14, 17)] == [False, False, True]
    assert array.tolist() == [20.0, 0.0]
    assert not check.jumped, "no joint is elsewhere"
