"""`object-mapping` in C leaves the bytes of the Python one, in any state that a hand brings it into."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.compiled import ODD, Pair, needs_c
from helpers.control import FIST, HOME, RELAXED, WORN, bound, hand_tips
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.hand.extra_finger import ExtraFinger
from srl.control.hand.object_mapping import ObjectMapping, ObjectMappingConfig
from srl.runtime.contracts.compiled import NotCompiledError, compiled
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import FingerModel

pytestmark = needs_c
LONG = ExtraFinger(
    name="finger",
    model=FingerModel(
        rows=((0.4, 0.02), (0.0, 0.03), (-1.1, 0.0), (0.0, 0.04), (0.0, 0.03)), lower=(-0.4,) * 5, upper=(0.9,) * 5
    ),
)
OPTIONS: list[dict[str, Any]] = [
    {}, {"points": ("thumb", "index", "ring"), "deformation": "rigid"}, {"gain_limit": np.inf, "damping": 1e-6},
    {"points": ("little", "thumb", "middle", "index"), "max_following_error": 0.004},
    {"fingers": (LONG,), "damping": 0.03},
]  # fmt: skip


def made(options: dict[str, Any]) -> ObjectMapping:
    return bound(ObjectMapping("mapping", ObjectMappingConfig.model_validate(options)), finger=WORN)


def metrics(pair: Pair) -> list[str]:
    pair.fast.leave()
    return [repr(law.metrics()) for law in (pair.python, pair.c)]


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from(OPTIONS), st.sampled_from([0.0, 3e-4, 3e-3, 0.03]))
@settings(max_examples=40, deadline=None)
def test_both_laws_do_the_same(seed: int, options: dict[str, Any], noise: float) -> None:
    """A hand that closes, opens and trembles, a glove that is slower; a guard that lags; values that can't be."""
    rng = np.random.default_rng(seed)
    pair = Pair(lambda: made(options))
    n, speed = len(pair.c.output["q"]), rng.uniform(0.01, 0.2)
    q: Array = np.resize(HOME, n)
    for k in range(40):
        if k == 0 or rng.random() < 0.7:
            u = 0.5 - 0.5 * np.cos(speed * k)
            tips = hand_tips(RELAXED + u * (FIST - RELAXED)) + noise * rng.normal(size=(5, 3))
        given = tips.copy()
        if rng.random() < 0.02:
            given.flat[rng.integers(15)] = rng.choice(ODD)
        if rng.random() < 0.05:
            pair.give(str(rng.choice(["drift_pull", "centring"])), rng.choice([0.0, 5.0, 100.0]), "param")
        pair.give("tips", given)
        pair.give("q", q, "applied")
        if k == 0 or rng.random() < 0.02:
            pair.reset()
        pair.step(0.01 if rng.random() > 0.05 else float(rng.choice([1e-3, 0.3])))
        assert pair.same_bits(), k
        asked = pair.python.output["q"]
        if np.isfinite(asked).all() and rng.random() > 0.05:
            q = q + rng.choice([1.0, 0.5, 0.0]) * (asked - q)
        elif rng.random() < 0.3:
            q = rng.uniform(-1.6, 1.6, n)
    assert len(set(metrics(pair))) == 1


@pytest.mark.parametrize("options", [OPTIONS[0], OPTIONS[2]])
def test_most_cycles_of_a_closing_hand_are_computed_in_c(options: dict[str, Any]) -> None:
    """Joints that come to their limits among them."""
    pair, held = Pair(lambda: made(options)), 0
    pair.give("q", HOME, "applied")
    for k in range(300):
        pair.give("tips", hand_tips(RELAXED + 0.5 * (1 - np.cos(0.02 * k)) * (FIST - RELAXED)))
        if k == 0:
            pair.reset()
        pair.step(0.01)
        assert pair.same_bits(), k
        pair.give("q", pair.python.output["q"], "applied")
        held += bool((np.abs(pair.python.output["q"]) > 1.57).any())
    assert pair.fast.rare < 60
    assert held > 20
    assert len(set(metrics(pair))) == 1


def test_state_goes_to_c_and_back_without_loss() -> None:
    pair = Pair(lambda: made({}))
    pair.give("q", HOME, "applied")
    for k in range(100):
        pair.give("tips", hand_tips(RELAXED + 0.005 * k * (FIST - RELAXED)))
        if k == 0:
            pair.reset()
        pair.python.update(0.01)
        if k % 7 == 3:
            pair.fast.leave()
            pair.c.update(0.01)
        else:
            pair.fast.update(0.01)
        assert pair.same_bits()
        pair.give("q", pair.python.output["q"], "applied")
    assert len(set(metrics(pair))) == 1


def test_a_law_that_reads_its_own_output_is_computed_in_c() -> None:
    def alone() -> ObjectMapping:
        law = made({})
        law.applied = {}
        law.output["q"][:] = HOME
        return law

    pair = Pair(alone)
    for k in range(50):
        pair.give("tips", hand_tips(RELAXED + 0.005 * k * (FIST - RELAXED)))
        if k == 0:
            pair.reset()
        pair.step(0.01)
        assert pair.same_bits()
    assert pair.fast.rare < 20


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"fingers": (ExtraFinger(name="a"), ExtraFinger(name="b"))}, "one finger"),
        ({"points": ("thumb", "index")}, "three fingertips"),
        ({"deformation": "shear"}, "similarity"),
    ],
)
def test_what_it_does_not_do_is_named(options: dict[str, Any], said: str) -> None:
    law = bound(ObjectMapping("mapping", ObjectMappingConfig.model_validate(options)))
    with pytest.raises(NotCompiledError, match=said):
        compiled(law)
