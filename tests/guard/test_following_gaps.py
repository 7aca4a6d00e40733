"""The following error through gaps, swings and long cycles: what is away is found, what isn't known is no error."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.compiled import bits, needs_c
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.contracts.compiled import undone
from srl.runtime.contracts.signals import Command, Kind, Stop
from srl.runtime.contracts.terms import PLANAR_TWIST
from srl.runtime.guard.following import TIMEOUT, WINDOW, FollowingError

DT = 0.01
AWAY = WINDOW["rad"] + 0.1
JOINTS = ("one", "two")
WAYS = [pytest.param(True, marks=needs_c), False]  # in C, in Python


class Limb:
    """Two joints, or a base, with their command."""

    def __init__(self, kind: Kind, in_c: bool = True, planar: bool = False, **more: object) -> None:
        size = 3 if planar else 2
        unit = "m/s, rad/s" if planar else {Kind.POSITION: "rad", Kind.VELOCITY: "rad/s"}[kind]
        self.command = Command(
            name="c", shape=(size,), unit=unit, labels=PLANAR_TWIST if planar else JOINTS, kind=kind, period=0.02,
            stops=(Stop.HOLD,), feedback="position", **more,  # type: ignore[arg-type]
        )  # fmt: skip
        self.measured, self.applied = np.zeros(size), np.zeros(size)
        self.error = FollowingError(self.command, self.measured, self.applied, np.full(size, 2.0))
        if not in_c:
            self.error._step = undone
        self.error.restart()

    def at(self, *measured: float, dt: float = DT, stale: bool = False) -> bool:
        self.measured[:] = measured
        return self.error.step(dt, stale)


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("dt", [0.002, 0.01, 0.05])
def test_a_limb_that_swings_around_a_command_that_stands_is_found(in_c: bool, dt: float) -> None:
    limb, t = Limb(Kind.POSITION, in_c), 0.0
    while not limb.at(1.5 * np.sin(2 * np.pi * t), 0.0, dt=dt):
        t += dt
        assert t < 5.0


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_a_limb_that_is_away_in_all_samples_but_each_50th_is_found(in_c: bool, kind: Kind) -> None:
    limb = Limb(kind, in_c)
    away = float(limb.error.window[0]) + 0.1
    assert any(limb.at(0.0 if k % 50 == 0 else away, 0.0) for k in range(200))


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_one_long_cycle_with_one_sample_away_is_no_error_that_lasts(in_c: bool, kind: Kind) -> None:
    limb = Limb(kind, in_c)
    away = float(limb.error.window[0]) + 0.1
    assert not any(limb.at(0.0, 0.0) for _ in range(20))
    assert not limb.at(away, 0.0, dt=0.6)
    assert not any(limb.at(0.0, 0.0) for _ in range(20))


@pytest.mark.parametrize("in_c", WAYS)
def test_a_limb_that_stays_away_through_long_cycles_is_found(in_c: bool) -> None:
    limb = Limb(Kind.POSITION, in_c)
    assert [limb.at(AWAY, 0.0, dt=0.6) for _ in range(5)] == [False] * 4 + [True]


@pytest.mark.parametrize("in_c", WAYS)
def test_a_limb_that_is_away_for_less_than_the_timeout_now_and_then_isn_t_found(in_c: bool) -> None:
    limb, away = Limb(Kind.POSITION, in_c), round(0.8 * TIMEOUT / DT)
    for _ in range(5):
        assert not any(limb.at(AWAY, 0.0) for _ in range(away))
        assert not any(limb.at(0.0, 0.0) for _ in range(5 * away))


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("planar", [False, True])
def test_a_limb_that_follows_exactly_and_is_measured_in_every_second_cycle_isn_t_found(
    in_c: bool, planar: bool
) -> None:
    limb, q = Limb(Kind.VELOCITY, in_c, planar), 0.0
    limb.applied[0] = 1.5
    for k in range(1000):
        q += 1.5 * DT
        place = [np.nan if k % 2 else q, *[0.0] * (limb.measured.size - 1)]
        assert not limb.at(*place), f"after {k * DT:.2f} s"
    assert np.abs(limb.error.errors()).max() < 0.05


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("planar", [False, True])
def test_a_limb_that_follows_exactly_and_isn_t_measured_for_a_while_isn_t_found(in_c: bool, planar: bool) -> None:
    limb, q = Limb(Kind.VELOCITY, in_c, planar), 0.0
    limb.applied[0] = 1.5
    for k in range(500):
        q += 1.5 * DT
        place = [np.nan if 100 <= k < 140 else q, *[0.0] * (limb.measured.size - 1)]
        assert not limb.at(*place)
    assert limb.error.fits()
    assert np.abs(limb.error.errors()).max() < 0.1


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
@pytest.mark.parametrize("stale", [0.1, 0.5, 1.0])
def test_what_went_on_while_its_sample_was_old_isn_t_found(in_c: bool, kind: Kind, stale: float) -> None:
    limb, q, shown = Limb(kind, in_c), 0.0, 0.0
    for k in range(500):
        q += 1.5 * DT
        limb.applied[0] = q if kind is Kind.POSITION else 1.5
        old = 1.0 <= k * DT < 1.0 + stale
        shown = shown if old else q
        assert not limb.at(shown, 0.0, stale=old)


@pytest.mark.parametrize("kind", [Kind.POSITION, Kind.VELOCITY])
def test_what_stood_while_its_sample_was_old_is_found(kind: Kind) -> None:
    limb, q, found = Limb(kind), 0.0, []
    for k in range(300):
        q += 1.5 * DT
        limb.applied[0] = q if kind is Kind.POSITION else 1.5
        old = 100 <= k < 150
        found.append(limb.at(q if k < 100 else 1.5, 0.0, stale=old))
    assert not any(found[:150])
    assert any(found[150:205])


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("turn", [2.0, -2.0])
def test_a_base_that_drives_in_a_circle_has_no_error(in_c: bool, turn: float) -> None:
    limb, dt, yaw = Limb(Kind.VELOCITY, in_c, planar=True), 0.05, 0.4
    limb.measured[2] = yaw
    limb.error.restart()
    limb.applied[:] = 1.5, 0.0, turn
    x = y = most = 0.0
    for _ in range(round(20.0 / dt)):
        after = yaw + turn * dt
        x, y = x + 1.5 / turn * (np.sin(after) - np.sin(yaw)), y - 1.5 / turn * (np.cos(after) - np.cos(yaw))
        yaw = after
        assert not limb.at(x, y, yaw, dt=dt)
        most = max(most, float(np.abs(limb.error.errors()).max()))
    assert most < 0.02


# -- pauses of the loop, and what is forgotten


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("speed", [0.5, -0.5])
@pytest.mark.parametrize("obeys", [0.0, 0.3, 1.0])
def test_whether_a_device_went_on_or_stopped_in_a_pause_is_no_error(in_c: bool, speed: float, obeys: float) -> None:
    limb, q = Limb(Kind.VELOCITY, in_c), 0.0
    limb.applied[0] = speed
    for k in range(100):
        pause = 1.0 if k % 20 == 10 else 0.0
        q += speed * DT if not pause else obeys * speed * pause
        assert not limb.at(q, 0.0, dt=pause or DT)
        assert np.abs(limb.error.errors()).max() < 1e-9


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("speed", [0.5, -0.5])
@pytest.mark.parametrize(("way", "beyond"), [(1.5, 1.0), (0.8, 0.3), (-0.4, -0.4), (-1.0, -1.0)])
def test_what_no_device_does_in_a_pause_is_an_error(in_c: bool, speed: float, way: float, beyond: float) -> None:
    """In 1 s it goes 0.5 rad forth at most, and never back."""
    limb = Limb(Kind.VELOCITY, in_c)
    limb.applied[0] = speed
    sign = np.sign(speed)
    limb.at(sign * way, 0.0, dt=1.0)
    assert limb.error.errors()[0] == pytest.approx(sign * beyond)
    assert limb.error.errors()[1] == 0.0


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("dt", [0.05, 0.2, 1.0, 30.0])
def test_a_pause_that_is_longer_than_the_lag_takes_the_late_place_to_the_command_and_not_beyond(
    in_c: bool, dt: float
) -> None:
    """A joint at its command, or where it was, is not away; one beyond the command is, by the whole way."""
    limb = Limb(Kind.POSITION, in_c, lag=0.02)
    limb.applied[0] = 1.0
    limb.at(1.2, 0.0, dt=dt)
    assert limb.error.errors()[0] == pytest.approx(0.2)
    limb.at(0.7, 0.0, dt=dt)
    assert limb.error.errors()[0] == pytest.approx(-0.3)


@pytest.mark.parametrize("in_c", WAYS)
def test_the_error_of_a_velocity_is_forgotten_in_a_long_pause_and_not_turned_over(in_c: bool) -> None:
    limb = Limb(Kind.VELOCITY, in_c)
    limb.at(0.2, 0.0)
    assert limb.error.errors()[0] == pytest.approx(0.2)
    limb.at(0.2, 0.0, dt=1.0)
    assert limb.error.errors()[0] == pytest.approx(0.18)
    limb.at(0.2, 0.0, dt=30.0)
    assert limb.error.errors()[0] == 0.0


@pytest.mark.parametrize("in_c", WAYS)
def test_the_time_beyond_the_window_goes_back_at_a_quarter_and_to_nothing(in_c: bool) -> None:
    limb, most = Limb(Kind.POSITION, in_c), round(TIMEOUT / DT)

    def found_after(within: int) -> int:
        """Cycles away from the window until it is found, after four fifths of the time-out and `within` in it."""
        limb.error.restart()
        for _ in range(round(0.8 * most)):
            assert not limb.at(AWAY, 0.0)
        for _ in range(within):
            assert not limb.at(0.0, 0.0)
        return next(k for k in range(1, 1000) if limb.at(AWAY, 0.0))

    assert found_after(0) == pytest.approx(0.2 * most, abs=1.5)
    assert found_after(round(0.8 * most)) == pytest.approx(0.4 * most, abs=1.5)
    assert found_after(round(3.2 * most)) == pytest.approx(most, abs=1.5)
    assert found_after(10 * most) == pytest.approx(most, abs=1.5)


@pytest.mark.parametrize("in_c", WAYS)
@pytest.mark.parametrize("to", [1.0, -1.0])
def test_between_its_command_and_what_follows_that_late_a_joint_has_no_error(in_c: bool, to: float) -> None:
    limb = Limb(Kind.POSITION, in_c, lag=0.2)
    limb.applied[0] = to
    for _ in range(10):
        limb.at(0.9 * to, 0.0)
        assert limb.error.errors()[0] == 0.0
    for place, error in ((1.1, 0.1), (-0.1, -0.1 - (1.0 - 0.95**10))):
        limb.measured[0] = place * to
        assert limb.error.errors()[0] == pytest.approx(error * to)


@pytest.mark.parametrize(("unit", "window"), [("rad/s", "rad"), ("m/s", "m"), ("1/s", "1")])
def test_a_velocity_has_the_window_of_its_position(unit: str, window: str) -> None:
    command = Command(name="c", shape=(1,), unit=unit, kind=Kind.VELOCITY, feedback="position", lag=0.0)
    made = FollowingError(command, np.zeros(1), np.zeros(1), np.ones(1))
    assert made.window.tolist() == [WINDOW[window]]


@pytest.mark.parametrize(("unit", "window"), [("rad", "rad"), ("m", "m"), ("N", "m"), ("1", "1"), ("furlong", "rad")])
def test_a_force_has_the_window_of_a_grippers_way(unit: str, window: str) -> None:
    command = Command(name="c", shape=(1,), unit=unit, kind=Kind.POSITION, feedback="position")
    made = FollowingError(command, np.zeros(1), np.zeros(1), np.ones(1))
    assert made.window.tolist() == [WINDOW[window]]


numbers = st.floats(-3, 3) | st.sampled_from((np.nan, np.inf, -np.inf, 1e300, -0.0))
series = st.lists(
    st.tuples(*[numbers] * 6, st.sampled_from((0.01, 0.01, 0.05, 0.3, 3.0)), st.booleans(), st.integers(1, 60)),
    max_size=12,
)


@needs_c
@settings(max_examples=50)
@given(series, st.sampled_from(("position", "velocity", "base")), st.sampled_from((0.0, 0.2)))
def test_c_finds_what_python_finds(rows: list[tuple[float, ...]], what: str, lag: float) -> None:
    kind = Kind.POSITION if what == "position" else Kind.VELOCITY
    both = [Limb(kind, in_c, what == "base", lag=lag) for in_c in (True, False)]
    for *values, dt, stale, times in rows:
        for _ in range(int(times)):
            found = []
            for limb in both:
                size = limb.measured.size
                limb.applied[:] = values[3 : 3 + size]
                with np.errstate(all="ignore"):
                    found.append(limb.at(*values[:size], dt=dt, stale=bool(stale)))
            assert found[0] == found[1]
            one, other = both[0].error, both[1].error
            with np.errstate(all="ignore"):
                assert bits(one.errors()) == bits(other.errors())
                assert one.fits() == other.fits()
            assert one._for == other._for
