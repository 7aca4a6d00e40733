"""A control value closes a finger: range, rate, holds, bumpless starts."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.control.hand.finger_closure import FingerClosure, FingerClosureConfig
from srl.runtime.models.models import FingerModel

OPEN = {"abduction": 0.0, "flexion_1": -0.2, "flexion_2": 0.1, "flexion_3": 0.0}
CLOSED = {"abduction": 0.1, "flexion_1": 1.1, "flexion_2": 1.2, "flexion_3": 0.9}
ENDS = np.array([[*OPEN.values()], [*CLOSED.values()]])
DT = 0.01


def closure(c: float, applied: np.ndarray | None = None, **options: object) -> FingerClosure:
    """The law after a reset at `c`, from the applied posture or from c's own."""
    law = bound(FingerClosure("closure", FingerClosureConfig(open=OPEN, closed=CLOSED, **options)))
    law.input["c"][0] = c
    law.applied["q"][:] = posture(c) if applied is None else applied
    law.reset()
    return law


def posture(c: float) -> np.ndarray:
    return ENDS[0] + np.clip(c, 0.0, 1.0) * (ENDS[1] - ENDS[0])


def step(law: FingerClosure, c: float, rate: float = 0.0) -> np.ndarray:
    law.input["c"][0], law.input["c_rate"][0] = c, rate
    law.update(DT)
    return law.output["q"].copy()


@given(st.floats(-3.0, 4.0))
def test_the_range_of_c_is_the_range_of_the_finger(c: float) -> None:
    found = step(closure(c), c)
    np.testing.assert_allclose(found, posture(c), atol=1e-12)
    assert (found >= ENDS.min(axis=0) - 1e-12).all()
    assert (found <= ENDS.max(axis=0) + 1e-12).all()


@given(st.lists(st.floats(0.0, 1.0), min_size=2, max_size=30), st.floats(-1.0, 1.5))
def test_the_velocity_is_the_positions_derivative(values: list[float], off: float) -> None:
    law = closure(values[0], applied=posture(values[0]) + 0.1 * off)
    before, last = law.output["q"].copy(), values[0]
    for c in values[1:]:
        now = step(law, c, (c - last) / DT)
        np.testing.assert_allclose(law.output["q_velocity"], (now - before) / DT, atol=1e-9)
        before, last = now, c


@given(st.floats(0.0, 1.0), st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
def test_it_starts_where_the_finger_is_and_comes_to_c(c: float, start: list[float]) -> None:
    law = closure(c, applied=np.array(start), catch_up=1.5)
    np.testing.assert_array_equal(law.output["q"], start)
    before = np.array(start)
    for _ in range(200):
        now = step(law, c)
        assert np.abs(now - before).max() <= 1.5 * DT + 1e-12
        before = now
    np.testing.assert_allclose(before, posture(c), atol=1e-12)


@given(st.lists(st.sampled_from([0.0, 0.3, 1.0, 7.0, np.nan, np.inf, -np.inf]), max_size=40), st.booleans())
def test_whatever_comes_the_command_is_finite_in_range_and_never_jumps_after_a_hold(
    values: list[float], rates: bool
) -> None:
    law = closure(0.3)
    before, held = posture(0.3), False
    for c in values:
        now = step(law, c, np.nan if rates else 0.0)
        assert np.isfinite(now).all()
        assert np.isfinite(law.output["q_velocity"]).all()
        if not np.isfinite(c):
            np.testing.assert_array_equal(now, before)
            assert not law.output["q_velocity"].any()
        elif held:
            assert np.abs(now - before).max() <= DT + 1e-12
        assert (now >= ENDS.min(axis=0) - 1e-9).all()
        assert (now <= ENDS.max(axis=0) + 1e-9).all()
        before, held = now, not np.isfinite(c)


def test_a_reset_without_a_finite_c_keeps_the_posture() -> None:
    start = np.array([0.1, 0.2, 0.3, 0.4])
    law = closure(np.nan, applied=start)
    np.testing.assert_array_equal(law.output["q"], start)
    np.testing.assert_allclose(step(law, 1.0), start + np.clip(posture(1.0) - start, -DT, DT))


def test_beyond_the_range_the_rate_is_zero() -> None:
    law = closure(1.2)
    step(law, 1.3, 10.0)
    assert not law.output["q_velocity"].any()


def test_a_finger_of_other_joints_closes_too() -> None:
    model = FingerModel(rows=((0.0, 0.05), (0.0, 0.04)), joints=("knuckle", "tip"), lower=-1.0, upper=2.0)
    options = {"model": model, "open": 0.0, "closed": {"tip": 1.5, "knuckle": 0.5}}
    law = bound(FingerClosure("closure", FingerClosureConfig(**options)))
    law.reset()
    for _ in range(200):
        found = step(law, 1.0)
    np.testing.assert_allclose(found, [0.5, 1.5])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"open": 0.0}, "closed"),
        ({"open": 0.0, "closed": {"flexion_1": 1.0}}, "'abduction' is missing"),
        ({"open": 0.0, "closed": CLOSED | {"flexion_4": 1.0}}, "flexion_4"),
        ({"open": 0.0, "closed": CLOSED | {"flexion_1": 2.0}}, "flexion_1 goes from"),
        ({"open": 0.3, "closed": 0.3}, "same posture"),
        ({"open": 0.0, "closed": float("nan")}, "finite"),
        ({"open": 0.0, "closed": 0.5, "catch_up": 0.0}, "greater than 0"),
        ({"open": 0.0, "closed": 0.5, "catch_up": float("inf")}, "finite"),
        ({"open": 0.0, "closed": 0.5, "model": "thum"}, "no finger called"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        FingerClosureConfig.model_validate(options)
