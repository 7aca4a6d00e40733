"""One of several signals, chosen by another one: thresholds, hysteresis, and how it goes over."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.conditioning.switch import Switch, SwitchConfig
from srl.testing import ControllerConformance, bound

DT = 0.01
ANY = st.floats(-10, 10) | st.sampled_from([np.nan, np.inf])


def law(applied: float | None = None, **options: Any) -> Switch:
    made = bound(Switch("switch", SwitchConfig(**options)))
    made.applied = {} if applied is None else {"y": np.full(made.output["y"].shape, applied)}
    for name in ("selector", *made._signals):
        made.input[name][:] = np.nan
    made.reset()
    return made


def step(made: Switch, selector: float, *values: float, cycles: int = 1) -> float:
    made.input["selector"][0] = selector
    for name, value in zip(made._signals, values, strict=True):
        made.input[name][:] = value
    for _ in range(cycles):
        made.update(DT)
    return float(made.output["y"][0])


class TestSwitch(ControllerConformance):
    inputs, start = {"selector": [1.0], "first": [0.3, 0.1], "second": [-2.0, 1.0]}, {"y": [0.1, 0.0]}
    change = "rate"

    def law(self) -> Switch:
        return bound(Switch("switch", SwitchConfig(labels=("a", "b"), change=self.change)))


class TestSwitchAtOnce(TestSwitch):
    change = "at-once"


class TestSwitchMeet(TestSwitch):
    change = "meet"


def test_the_selector_chooses_by_thresholds_and_goes_back_below_the_hysteresis() -> None:
    made = law(signals=("a", "b", "c"), thresholds=(1.0, 2.0), hysteresis=0.2, change="at-once", selector_unit="N")
    steps = [(0.0, 0), (0.99, 0), (1.0, 1), (0.81, 1), (0.79, 0), (2.5, 2), (1.81, 2), (1.79, 1), (3.0, 2), (-1.0, 0)]
    for selector, chosen in steps:
        assert step(made, selector, 10.0, 20.0, 30.0) == (10.0, 20.0, 30.0)[chosen], selector
        assert made.output["chosen"][0] == chosen
    assert made.inputs[0].unit == "N"


@given(selectors=st.lists(st.floats(0.91, 1.09), max_size=50), begin=st.sampled_from([0.0, 2.0]))
def test_a_selector_that_shakes_by_less_than_the_hysteresis_switches_once(selectors: list[float], begin: float) -> None:
    made = law(thresholds=(1.0,), hysteresis=0.1)
    step(made, begin, 0.0, 1.0)
    seen = [made.output["chosen"][0]]
    for selector in selectors:
        step(made, selector, 0.0, 1.0)
        seen.append(made.output["chosen"][0])
    assert np.count_nonzero(np.diff(seen)) <= 1


@given(
    steps=st.lists(st.tuples(ANY, ANY, ANY), max_size=60), applied=st.floats(-5, 5) | st.none(),
    change=st.sampled_from(["rate", "meet"]),
)  # fmt: skip
def test_it_never_jumps_whatever_is_chosen(
    steps: list[tuple[float, float, float]], applied: float | None, change: str
) -> None:
    """Apart from the chosen input's own motion it moves at `catch_up` at most."""
    made = law(applied, change=change, catch_up=3.0)
    last = float(made.output["y"][0])
    before: tuple[float, ...] = (np.nan, np.nan)
    for selector, *values in steps:
        y = step(made, selector, *values)
        i = made._chosen
        own = abs(values[i] - before[i]) if i >= 0 else 0.0
        if np.isfinite(last):
            assert np.isfinite(y)
            assert abs(y - last) <= (own if np.isfinite(own) else 0.0) + 3.0 * DT + 1e-9
        last, before = y, tuple(values)


def test_by_rate_it_goes_over_and_then_follows() -> None:
    made = law(change="rate", catch_up=2.0)
    assert step(made, 0.0, 1.0, 2.0) == 1.0
    assert step(made, 1.0, 1.0, 2.0, cycles=25) == pytest.approx(1.5)
    assert step(made, 1.0, 1.0, 2.0, cycles=50) == 2.0
    assert step(made, 1.0, 1.0, 7.0) == 7.0


def test_by_meet_it_holds_until_the_new_input_has_come_there_or_past_it() -> None:
    for near, arrives in ((0.0, 1.4), (0.1, 1.09)):
        made = law(change="meet", near=near, catch_up=1e6)
        step(made, 0.0, 1.0, 2.0)
        assert step(made, 1.0, 5.0, 2.0) == 1.0  # what was chosen before no longer counts
        assert step(made, 1.0, 5.0, 1.2) == 1.0
        past = 0.9 if near == 0.0 else arrives
        assert step(made, 1.0, 5.0, past) == pytest.approx(past)
        assert step(made, 1.0, 5.0, 3.0) == 3.0
        assert not made.lost


def test_by_meet_each_element_waits_for_itself() -> None:
    made = law(labels=("a", "b"), change="meet")
    step(made, 0.0, 1.0, 0.0)
    made.input["selector"][0] = 1.0
    made.input["second"][:] = [1.0, 5.0]
    made.update(DT)
    np.testing.assert_array_equal(made.output["y"], [1.0, 1.0])
    made.input["second"][:] = [1.5, 5.5]
    made.update(DT)
    np.testing.assert_array_equal(made.output["y"], [1.5, 1.0])


def test_at_once_jumps_but_not_at_a_reset() -> None:
    made = law(0.0, change="at-once", catch_up=1.0)
    assert step(made, 0.0, 1.0, 2.0) == pytest.approx(0.01)
    assert step(made, 1.0, 1.0, 2.0) == 2.0


def test_what_isnt_chosen_may_be_unknown_and_what_is_chosen_may_not() -> None:
    made = law(max_hold=0.05, change="at-once")
    step(made, 0.0, 1.0, np.nan, cycles=20)
    assert not made.lost
    assert step(made, 1.0, 1.0, np.nan, cycles=5) == 1.0
    assert not made.lost
    step(made, 1.0, 1.0, np.nan)
    assert made.lost
    assert step(made, 0.0, 1.0, np.nan) == 1.0
    assert not made.lost


def test_an_unknown_selector_changes_nothing_and_is_lost_after_a_while() -> None:
    made = law(max_hold=0.05)
    assert np.isnan(step(made, np.nan, 1.0, 2.0, cycles=3))  # nothing was chosen yet
    assert step(made, 1.0, 1.0, 2.0) == 2.0
    assert step(made, np.nan, 1.0, 2.5, cycles=5) == 2.5
    assert not made.lost
    step(made, np.nan, 1.0, 2.5)
    assert made.lost
    step(made, 1.0, 1.0, 2.5)
    assert not made.lost


def test_a_reset_chooses_anew() -> None:
    made = law(thresholds=(1.0,), hysteresis=0.5)
    step(made, 2.0, 0.0, 1.0)
    step(made, 0.8, 0.0, 1.0)
    assert made.output["chosen"][0] == 1
    made.reset()
    assert made.output["chosen"][0] == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"signals": ("a",)}, "at least 2"),
        ({"signals": ("a", "a")}, "name of its own"),
        ({"signals": ("a", "selector")}, "name of its own"),
        ({"signals": ("a", "b", "c")}, "1 thresholds between 3 signals"),
        ({"signals": ("a", "b", "c"), "thresholds": (2.0, 1.0)}, "must rise"),
        ({"signals": ("a", "b", "c"), "thresholds": (1.0, 2.0), "hysteresis": 1.0}, "must rise, by more"),
        ({"thresholds": (np.nan,)}, "finite"),
        ({"change": "slowly"}, "'rate', 'meet' or 'at-once'"),
    ],
)
def test_options_that_dont_fit_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        SwitchConfig(**options)
