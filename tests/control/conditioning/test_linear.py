"""A signal with gain, offset, dead band and ranges; and what all general laws share: holds, losses, no jumps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.conditioning.linear import Linear, LinearConfig
from srl.testing import ControllerConformance, bound

DT = 0.01
ANY = st.floats(-1e6, 1e6) | st.sampled_from([np.nan, np.inf, -np.inf])


def law(applied: float | None = None, first: float = 0.0, **options: Any) -> Linear:
    """The law after a reset; `applied`: where the device is that it commands, if it commands one."""
    made = bound(Linear("linear", LinearConfig(**options)))
    made.applied = {} if applied is None else {"y": np.full(made.output["y"].shape, applied)}
    made.input["x"][:] = first
    made.reset()
    return made


def step(made: Linear, x: float, cycles: int = 1) -> float:
    for _ in range(cycles):
        made.input["x"][:] = x
        made.update(DT)
    return float(made.output["y"][0])


class TestLinear(ControllerConformance):
    inputs, start = {"x": [0.3, -0.2]}, {"y": [0.1, 2.0]}

    def law(self) -> Linear:
        return bound(Linear("linear", LinearConfig(labels=("a", "b"), gain={"a": 2.0, "b": -1.0}, out_upper=0.4)))


@pytest.mark.parametrize(
    ("x", "y"),
    [(0.5, 10.0), (0.59, 10.0), (0.7, 8.0), (0.3, 12.0), (0.9, 5.0), (1e9, 5.0), (0.0, 15.0), (-1e9, 15.0)],
)
def test_the_dead_band_is_taken_away_and_both_ranges_hold(x: float, y: float) -> None:
    made = law(
        gain=-20.0, offset=10.0, rest=0.5, dead_band=0.1, in_lower=0.1, in_upper=0.9, out_lower=5.0, out_upper=15.0
    )
    assert step(made, x) == pytest.approx(y)


def test_each_element_has_its_own_values_by_name_in_any_order() -> None:
    made = law(labels=("a", "b"), gain={"b": 3.0, "a": 2.0}, offset={"b": -1.0, "a": 1.0}, in_unit="m", out_unit="rad")
    made.input["x"][:] = [1.0, 2.0]
    made.update(DT)
    np.testing.assert_array_equal(made.output["y"], [3.0, 5.0])
    assert (made.inputs[0].unit, made.outputs[0].unit, made.outputs[0].labels) == ("m", "rad", ("a", "b"))


@given(
    first=st.floats(-10, 10), second=st.floats(-10, 10), band=st.floats(0, 5), gain=st.floats(-5, 5),
    rest=st.floats(-5, 5),
)  # fmt: skip
def test_it_is_monotone_and_no_steeper_than_its_gain(
    first: float, second: float, band: float, gain: float, rest: float
) -> None:
    made = law(gain=gain, dead_band=band, rest=rest, in_lower=-8.0, in_upper=8.0, out_lower=-7.0, out_upper=7.0)
    low, high = step(made, first), step(made, second)
    assert (high - low) * (second - first) * np.sign(gain) >= -1e-9
    assert abs(high - low) <= abs(gain * (second - first)) + 1e-9
    assert max(abs(low), abs(high)) <= 7.0


@given(values=st.lists(ANY, max_size=60), applied=st.floats(-10, 10), first=ANY, catch_up=st.floats(0.1, 10))
def test_what_commands_a_device_never_jumps(values: list[float], applied: float, first: float, catch_up: float) -> None:
    """Apart from the input's own motion it moves at `catch_up` at most, whatever comes; and it is finite."""
    made = law(applied, first, catch_up=catch_up)
    last, before = float(made.output["y"][0]), np.nan
    assert last == applied
    for value in values:
        y = step(made, value)
        assert np.isfinite(y)
        own = abs(value - before) if np.isfinite(value) and np.isfinite(before) else 0.0
        assert abs(y - last) <= own + catch_up * DT + 1e-9 * (1.0 + own)
        if not np.isfinite(value):
            assert y == last
        last, before = y, value


def test_after_a_reset_or_a_hold_it_comes_to_where_it_should_be_at_its_rate() -> None:
    made = law(0.0, 1.0, catch_up=2.0)
    assert step(made, 1.0, 25) == pytest.approx(0.5)
    assert step(made, np.nan, 10) == pytest.approx(0.5)
    assert step(made, 0.8, 5) == pytest.approx(0.6)
    assert step(made, 0.8, 50) == 0.8
    assert step(made, 0.1) == pytest.approx(0.1)  # then it follows at once


def test_elsewhere_it_is_unknown_until_there_is_a_value_and_follows_at_once() -> None:
    made = law(None, np.nan)
    assert np.isnan(step(made, np.nan, 3))
    assert step(made, 5.0) == 5.0
    assert step(made, np.nan) == 5.0
    assert step(made, -5.0) == -5.0


def test_one_unknown_element_is_held_while_the_others_go_on() -> None:
    made = law(labels=("a", "b"))
    for x, y in (([1.0, 2.0], [1.0, 2.0]), ([np.nan, 3.0], [1.0, 3.0]), ([4.0, np.inf], [4.0, 3.0])):
        made.input["x"][:] = x
        made.update(DT)
        np.testing.assert_array_equal(made.output["y"], y)


def test_what_stays_unknown_is_lost_and_a_reset_or_a_value_ends_that() -> None:
    made = law(max_hold=0.1)
    step(made, 1.0)
    step(made, np.nan, 10)
    assert not made.lost
    step(made, np.nan, 2)
    assert made.lost
    step(made, 1.0)
    assert not made.lost
    step(made, np.nan, 30)
    made.reset()
    assert not made.lost
    patient = law(max_hold=np.inf)
    step(patient, np.nan, 300)
    assert not patient.lost


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"dead_band": -0.1}, "below 0"),
        ({"labels": ("a", "a")}, "more than once"),
        ({"labels": ("a", "b"), "gain": {"a": 1.0}}, "gain: 'b' is missing"),
        ({"gain": {"a": 1.0}}, "no element is called 'a'"),
        ({"out_lower": 1.0, "out_upper": 1.0}, "'out_lower' isn't below 'out_upper'"),
        ({"labels": ("a", "b"), "in_lower": {"a": 0.0, "b": 1.0}, "in_upper": 0.5}, "'in_lower' isn't below"),
        ({"gain": np.inf}, "finite"),
        ({"gain": True}, "switch"),
        ({"catch_up": 0.0}, "greater than 0"),
        ({"max_hold": np.nan}, "greater than or equal to 0"),
    ],
)
def test_options_that_dont_fit_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        LinearConfig(**options)
