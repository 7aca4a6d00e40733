"""Control values from an axis, as position and as rate, and from presses of a button."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.setpoint.axis_position import AxisPosition, AxisPositionConfig
from srl.control.setpoint.axis_rate import AxisRate, AxisRateConfig
from srl.control.setpoint.press_toggle import PressToggle, PressToggleConfig
from srl.runtime.contracts.controller import Controller

DT = 0.01
ANY = st.floats(allow_nan=True, allow_infinity=True)
LAWS = {
    "axis-position": lambda: AxisPosition("c", AxisPositionConfig(lower=-1.0, dead_band=0.1)),
    "axis-rate": lambda: AxisRate("c", AxisRateConfig()),
    "press-toggle": lambda: PressToggle("c", PressToggleConfig()),
}
SPEEDS = {"axis-position": 5.0, "axis-rate": 0.5, "press-toggle": 1.0}


def started(law: Controller, first: float = 0.0, applied: float | None = None) -> Controller:
    """The law after a reset at which its input was `first`."""
    bound(law)
    law.input[law.inputs[0].name][0] = first
    if applied is not None:
        law.applied = {"c": np.array([applied])}
    law.reset()
    return law


def step(law: Controller, value: float, cycles: int = 1) -> float:
    for _ in range(cycles):
        law.input[law.inputs[0].name][0] = value
        law.update(DT)
    return float(law.output["c"][0])


@pytest.mark.parametrize("name", LAWS)
@given(values=st.lists(ANY, max_size=60), applied=st.floats(0.0, 1.0), first=ANY)
def test_whatever_comes_c_stays_in_range_at_a_limited_speed(
    name: str, values: list[float], applied: float, first: float
) -> None:
    law = started(LAWS[name](), first, applied)
    last = float(law.output["c"][0])
    assert last == applied
    assert law.output["c_rate"][0] == 0.0
    for value in values:
        c = step(law, value)
        assert 0.0 <= c <= 1.0
        assert abs(c - last) <= SPEEDS[name] * DT + 1e-12
        assert law.output["c_rate"][0] == pytest.approx((c - last) / DT)
        if not np.isfinite(value):
            assert c == last
        last = c


@pytest.mark.parametrize("name", LAWS)
def test_a_reset_without_a_device_behind_c_keeps_it(name: str) -> None:
    law = started(LAWS[name]())
    step(law, 0.0)
    c = step(law, 1.0, 5)
    law.reset()
    assert law.output["c"][0] == c


@given(
    ends=st.tuples(st.floats(-1, 1), st.floats(-1, 1)).filter(lambda e: abs(e[0] - e[1]) > 0.1),
    where=st.floats(0, 1), band=st.floats(0, 0.9), axes=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
)  # fmt: skip
def test_position_is_monotone_continuous_and_reaches_its_ends(
    ends: tuple[float, float], where: float, band: float, axes: tuple[float, float]
) -> None:
    lower, upper = ends
    rest = float(np.clip(lower + where * (upper - lower), *sorted(ends)))
    sides = [side for side in (abs(rest - lower), abs(upper - rest)) if side > 0.0]
    options = AxisPositionConfig(lower=lower, upper=upper, rest=rest, dead_band=band * min(sides), speed=1e6)
    law = started(AxisPosition("c", options))
    step(law, rest)
    assert step(law, lower) == pytest.approx(0.0, abs=1e-9)
    assert step(law, upper) == pytest.approx(1.0)
    at_rest = step(law, rest)
    for sign in (-1, 1):
        assert step(law, rest + sign * options.dead_band * 0.999) == pytest.approx(at_rest)
    first, second = (step(law, axis) for axis in sorted(axes, reverse=upper < lower))
    assert first <= second + 1e-12
    steepest = 1 / min(side - options.dead_band for side in sides) * max(sides) / abs(upper - lower)
    assert second - first <= steepest * abs(axes[0] - axes[1]) + 1e-6


def test_a_held_button_closes_and_a_released_one_opens() -> None:
    law = started(AxisPosition("c", AxisPositionConfig(speed=1.0)))
    step(law, 0.0)
    assert step(law, 1.0, 50) == pytest.approx(0.5)
    assert step(law, 0.0, 20) == pytest.approx(0.3)


def test_a_trigger_that_was_pulled_or_let_go_meanwhile_moves_nothing_until_it_has_met_c() -> None:
    law = started(AxisPosition("c", AxisPositionConfig()), first=1.0, applied=0.0)
    assert step(law, 1.0, 20) == 0.0
    assert step(law, 0.5, 20) == 0.0
    assert step(law, 0.0, 20) == 0.0
    assert step(law, 0.5, 20) == pytest.approx(0.5)
    law = started(AxisPosition("c", AxisPositionConfig()), first=0.0, applied=0.8)
    assert step(law, 0.0, 20) == 0.8
    assert step(law, 0.6, 20) == 0.8
    assert step(law, np.nan, 20) == 0.8
    assert step(law, 0.9, 20) == pytest.approx(0.9)  # it has gone past c
    assert step(law, 0.0, 20) == 0.0


@given(deflection=st.floats(-1.0, 1.0), cycles=st.integers(1, 150))
def test_rate_is_the_integral_of_the_deflection_beyond_the_dead_band(deflection: float, cycles: int) -> None:
    law = started(AxisRate("c", AxisRateConfig()), applied=0.5)
    step(law, 0.0)
    rate = 0.5 * np.sign(deflection) * max(abs(deflection) - 0.1, 0.0) / 0.9
    assert step(law, deflection, cycles) == pytest.approx(np.clip(0.5 + rate * cycles * DT, 0.0, 1.0), abs=1e-9)


def test_rate_does_not_wind_up_at_a_limit() -> None:
    law = started(AxisRate("c", AxisRateConfig()), applied=0.9)
    step(law, 0.0)
    assert step(law, 1.0, 1000) == 1.0
    assert law.output["c_rate"][0] == 0.0
    assert step(law, -1.0) == pytest.approx(1.0 - 0.5 * DT)


def test_rate_ignores_a_stick_that_is_deflected_during_the_reset_until_it_rests() -> None:
    law = started(AxisRate("c", AxisRateConfig()), first=1.0, applied=0.4)
    assert step(law, 1.0, 10) == 0.4
    assert step(law, np.nan, 10) == 0.4
    assert step(law, 1.0, 10) == 0.4
    step(law, 0.05)
    assert step(law, 1.0, 10) == pytest.approx(0.45)


def test_rate_turned_round() -> None:
    law = started(AxisRate("c", AxisRateConfig(full=-1.0)), applied=0.5)
    step(law, 0.0)
    assert step(law, -1.0) > 0.5


@pytest.mark.parametrize("counts", [True, False])
def test_each_press_turns_round_even_halfway(counts: bool) -> None:
    law = started(PressToggle("c", PressToggleConfig()), first=7.0 if counts else 0.0)
    press = iter((8.0, 9.0, 10.0)) if counts else iter((1.0, 1.0, 1.0))
    now = 7.0 if counts else 0.0
    for sense in (1.0, -1.0, 1.0):
        before = step(law, now if counts else 0.0)
        now = next(press)
        assert step(law, now, 30) - before == pytest.approx(sense * 0.3, abs=0.02)


def test_presses_that_no_cycle_saw_apart_count_too() -> None:
    law = started(PressToggle("c", PressToggleConfig()))
    assert step(law, 2.0, 10) == 0.0
    assert step(law, 5.0, 10) == pytest.approx(0.1)


def test_a_reset_stands_still_until_the_next_press() -> None:
    law = started(PressToggle("c", PressToggleConfig()))
    assert step(law, 1.0, 40) == pytest.approx(0.4)
    law.input["presses"][0] = 2.0  # pressed while it stood
    law.reset()
    assert step(law, 2.0, 10) == pytest.approx(0.4)
    assert step(law, 3.0, 10) == pytest.approx(0.5)


def test_a_count_that_falls_is_no_press() -> None:
    law = started(PressToggle("c", PressToggleConfig()), first=9.0)
    assert step(law, 0.0, 10) == 0.0
    assert step(law, np.nan, 10) == 0.0
    assert step(law, 1.0, 10) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "options",
    [{"lower": 1.0}, {"rest": 2.0}, {"dead_band": 1.0}, {"lower": -1.0, "dead_band": 1.0}, {"speed": 0.0}],
)
def test_options_of_a_position_that_can_not_work_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        AxisPositionConfig(**options)


@pytest.mark.parametrize("options", [{"full": 0.05}, {"dead_band": 1.0}, {"begin": 2.0}, {"speed": float("nan")}])
def test_options_of_a_rate_that_can_not_work_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        AxisRateConfig(**options)
