"""What the wearer feels: level, rise, time without a pause, mean; off at once; cues within the same limits."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest
from helpers.guard import guard_of
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.cue import Cue
from srl.runtime.contracts.errors import SrlError, WiringError
from srl.runtime.contracts.signals import Kind, Stop
from srl.runtime.guard import IntensityGuard
from srl.runtime.guard.intensity import PAUSE, WINDOW
from srl.runtime.profile import profile, wiring

DT = 0.01
LIMITS = {"level": 0.9, "level_rate": 20.0, "on_time": 2.0, "duty": 0.4}


def felt(**limits: float) -> IntensityGuard:
    made = guard_of(Kind.INTENSITY, dt=DT, **LIMITS | limits)
    assert isinstance(made, IntensityGuard)
    made.bind(np.zeros(1))
    made.reset(np.zeros(1))
    return made


def step(guard: IntensityGuard, wanted: float, dt: float = DT) -> float:
    guard.step(np.array([wanted]), None, dt)
    return float(guard.applied[0])


wanted = st.one_of(st.floats(-1, 3), st.sampled_from([nan, inf, -inf, 1.0, 0.0, 1e300]))
pieces = st.lists(st.tuples(wanted, st.integers(1, 400), st.floats(0.002, 0.04)), min_size=1, max_size=8)


@given(pieces)
@settings(max_examples=60, deadline=None)
def test_limits_hold_for_any_demand(pieces: list[tuple[float, int, float]]) -> None:
    guard, before, on, time, total = felt(), 0.0, 0.0, 0.0, 0.0
    for value, count, dt in pieces:
        for _ in range(count):
            level = step(guard, value, dt)
            assert 0.0 <= level <= min(LIMITS["level"], before + LIMITS["level_rate"] * dt + 1e-12)
            on = on + dt if level > 0.0 else 0.0
            assert on <= LIMITS["on_time"] + 1e-9
            time, total, before = time + dt, total + level * dt, level
    # A low-pass mean never goes above the duty by more than a cycle's share, so what was on is bounded by time.
    assert total <= LIMITS["duty"] * (time + WINDOW) + 0.1


def test_it_rises_within_its_rate_and_falls_at_once() -> None:
    guard = felt()
    assert [round(step(guard, 1.0), 6) for _ in range(6)] == [0.2, 0.4, 0.6, 0.8, 0.9, 0.9]
    assert guard.limited
    assert step(guard, 0.0) == 0.0


def test_after_its_time_it_pauses() -> None:
    guard = felt(duty=1.0)
    levels = [step(guard, 0.5) for _ in range(600)]
    off = [i for i, level in enumerate(levels) if level == 0.0]
    assert off[0] == pytest.approx(2.0 / DT, abs=1)
    assert len([i for i in off if i < off[0] + 100]) == pytest.approx(PAUSE / DT, abs=1)


def test_thirty_minutes_of_a_full_demand_keep_the_duty_and_a_reset_forgets_nothing() -> None:
    guard = felt()
    levels = []
    for i in range(30 * 60 * 100):
        if i % 5000 == 0:
            guard.reset(np.zeros(1))
        levels.append(step(guard, 1.0))
    windows = np.array(levels).reshape(-1, 6000).mean(axis=1)  # of a minute
    assert LIMITS["duty"] * 0.7 < windows.min()
    assert windows.max() < LIMITS["duty"] + 0.1


@pytest.mark.parametrize("category", [Stop.OFF, Stop.HOLD, Stop.RETRACT])
def test_every_stop_is_off_at_once_and_at_rest(category: Stop) -> None:
    guard = felt()
    step(guard, 1.0)
    guard.stop(category, DT)
    assert guard.applied[0] == 0.0
    assert guard.at_rest


def test_what_is_not_finite_is_off() -> None:
    guard = felt()
    step(guard, 1.0)
    assert step(guard, nan) == 0.0
    assert guard.rejected


@pytest.mark.parametrize(("loss", "pulses"), [(False, 2), (True, 3)])
def test_a_cue_is_given_once_within_the_limits(loss: bool, pulses: int) -> None:
    guard = felt()
    guard.stop_cue, guard.loss_cue = Cue(pulses=2), Cue(pulses=3, level=1.0)
    guard.announce(loss)
    levels = []
    for _ in range(300):
        guard.stop(Stop.OFF, DT)
        assert guard.at_rest
        levels.append(float(guard.applied[0]))
    on = np.array(levels) > 0.0
    assert (np.diff(on.astype(int)) == 1).sum() + on[0] == pulses
    assert max(levels) <= LIMITS["level"]
    assert not on[100:].any()
    guard.reset(np.zeros(1))
    guard.stop(Stop.OFF, DT)
    assert guard.applied[0] == 0.0  # a reset ends it


@pytest.mark.parametrize(
    ("kind", "limits", "words"),
    [
        (Kind.INTENSITY, LIMITS | {"velocity": 1.0}, "of kind intensity has no velocity"),
        (Kind.INTENSITY, {"level": 1.0}, "needs level_rate, on_time, duty"),
        (Kind.POSITION, {"velocity": 1.0, "acceleration": 1.0, "level": 1.0}, "of kind position has no level"),
    ],
)
def test_limits_that_say_something_else_are_refused(kind: Kind, limits: dict[str, float], words: str) -> None:
    with pytest.raises(WiringError, match=words):
        guard_of(kind, dt=DT, **limits)


def test_a_link_that_stalled_at_a_level_is_told_off_first() -> None:
    """The board goes on with what it had; the guard goes on from there, and falls at once."""
    guard, sent = felt(), np.zeros(1)
    guard.bind(guard.applied, sent=sent)
    for _ in range(10):
        guard.resynchronise(True, DT)
        sent[0] = step(guard, 0.9)
    for _ in range(50):  # nothing leaves
        guard.resynchronise(False, DT)
        step(guard, 0.2)
    assert guard.resyncs
    guard.resynchronise(False, DT)
    guard.stop(Stop.OFF, DT)
    assert guard.applied[0] == 0.0


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("guard.cuff.intensity_command.level", "5", "less than or equal to 1"),
        ("guard.cuff.intensity_command.duty", "50", "less than or equal to 1"),
        ("guard.cuff.intensity_command.following_error", "{window: 0.1}", "nothing measures what is felt"),
        ("guard.thumb.position_command.stop_cue", "{pulses: 2}", "of kind position gives no cues"),
    ],
)
def test_a_profile_that_says_something_else_is_refused(key: str, value: str, words: str) -> None:
    with pytest.raises(SrlError, match=words):
        wiring.build(*profile.load("third-thumb", ["feedback=cuff", f"{key}={value}"]))
