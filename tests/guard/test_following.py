"""A limb that isn't where it was commanded is found, one that is only late isn't."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.compiled import needs_c
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.contracts.compiled import undone
from srl.runtime.contracts.signals import Command, Kind, Stop
from srl.runtime.contracts.terms import PLANAR_TWIST
from srl.runtime.guard.following import SLIPS, TIMEOUT, WINDOW, FollowingError

DT = 0.01
JOINTS = ("one", "two")


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

    def run(self, seconds: float) -> bool:
        for _ in range(round(seconds / DT)):
            self.error.step(DT)
        return self.error.exceeded


@pytest.mark.parametrize("in_c", [True, False])
def test_a_joint_that_stays_away_is_found_after_the_timeout(in_c: bool) -> None:
    limb = Limb(Kind.POSITION, in_c)
    limb.measured[1] = WINDOW["rad"] + 0.01
    assert not limb.run(TIMEOUT - DT)
    assert limb.run(3 * DT)
    assert limb.error.errors().tolist() == [0.0, pytest.approx(WINDOW["rad"] + 0.01)]
    limb.measured[1] = WINDOW["rad"] - 0.01
    assert not limb.run(DT)


def test_a_weak_joint_that_falls_is_found() -> None:
    limb, fallen = Limb(Kind.POSITION), 0.0
    while not limb.error.exceeded:
        fallen += 1.5 * DT
        limb.measured[0] = -fallen
        limb.error.step(DT)
        assert fallen < 1.2


@given(st.lists(st.floats(-2, 2), min_size=1, max_size=40), st.floats(0.01, 0.2))
def test_a_joint_that_is_only_late_is_never_found(speeds: list[float], lag: float) -> None:
    """It follows with a first order lag, or a dead time, up to the declared one."""
    limb = Limb(Kind.POSITION, lag=0.2)
    past = [np.zeros(2)] * (round(lag / DT) + 1)
    for speed in speeds:
        for _ in range(10):
            limb.applied[:] += speed * DT
            past = [*past[1:], limb.applied.copy()]
            limb.measured[0] += (limb.applied[0] - limb.measured[0]) * DT / lag
            limb.measured[1] = past[0][1]
            limb.error.step(DT)
            assert limb.error.fits()


def test_a_joint_that_doesn_t_turn_at_all_is_found() -> None:
    limb = Limb(Kind.VELOCITY)
    limb.applied[0] = 1.0
    assert limb.run(2.0)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_velocity_whose_scale_is_a_little_off_isn_t_found(share: float) -> None:
    limb = Limb(Kind.VELOCITY)
    limb.applied[0] = 2.0
    for _ in range(1000):
        limb.measured[0] += share * 2.0 * DT
        assert not limb.error.step(DT)


@pytest.mark.parametrize("in_c", [True, False])
@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_a_bases_way_is_compared_in_its_own_axes(in_c: bool, yaw: float) -> None:
    limb = Limb(Kind.VELOCITY, in_c, planar=True)
    limb.measured[2] = yaw
    limb.error.restart()
    limb.applied[:] = 0.5, 0.2, 0.0
    c, s = np.cos(yaw), np.sin(yaw)
    for _ in range(1000):
        limb.measured[:2] += DT * np.array([c * 0.5 - s * 0.2, s * 0.5 + c * 0.2])
        limb.error.step(DT)
    assert np.abs(limb.error.errors()).max() < 1e-9
    assert not limb.error.exceeded
    assert limb.run(2 * SLIPS)  # now its wheels are blocked


numbers = st.floats(-10, 10) | st.sampled_from((np.nan, 1e300))


@needs_c
@given(st.lists(st.tuples(*[numbers] * 6), max_size=20), st.booleans(), st.sampled_from(list(Kind)[:2]))
def test_c_finds_what_python_finds(series: list[tuple[float, ...]], planar: bool, kind: Kind) -> None:
    planar = planar and kind is Kind.VELOCITY
    both = [Limb(kind, in_c, planar) for in_c in (True, False)]
    for values in series:
        found = []
        for limb in both:
            size = len(limb.measured)
            limb.measured[:], limb.applied[:] = values[:size], values[3 : 3 + size]
            with np.errstate(all="ignore"):
                found.append(limb.error.step(DT))
        assert found[0] == found[1]
        assert both[0].error._state.tobytes() == both[1].error._state.tobytes()


@pytest.mark.parametrize("in_c", [True, False])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_one_value_that_is_not_known_ends_nothing_for_good(in_c: bool, wrong: float) -> None:
    """It made the error of a velocity NaN, and no reset was granted any more."""
    limb = Limb(Kind.VELOCITY, in_c)
    limb.run(1.0)
    limb.measured[0] = wrong
    limb.run(DT)
    limb.measured[0] = 0.0
    assert not limb.run(1.0)
    assert limb.error.fits()


def test_a_joint_that_slides_has_the_window_of_its_unit() -> None:
    limb = Limb(Kind.POSITION, slides=("two",))
    assert limb.error.window.tolist() == [WINDOW["rad"], WINDOW["m"]]
