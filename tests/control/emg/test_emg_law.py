"""The law `emg-activation`: the toolkit's processing online, whatever the cycles bring, and no false activation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.emg.blocks import joined_samples
from srl.control.emg.law import EmgActivation, EmgActivationConfig
from srl.control.emg.processing import Filters, OnlineEnvelope
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.signals import Array
from srl.studies.toolkit import semg

REST, MVC = 2e-6, 4e-4
MADE = {
    "format": "srl-emg-1", "person": "P07", "date": "2026-02-03", "simulated": False, "signal": "emg.samples",
    "rate": 2000.0, "band": [20.0, 450.0], "band_order": 4, "cutoff": 5.0, "cutoff_order": 2, "window": 0.5,
    "muscles": {name: {"rest": REST, "mvc": MVC, "repeats": [MVC, MVC]} for name in ("biceps", "triceps")},
}  # fmt: skip
BLOCK = 64
DT = 0.01


class Worn:
    """The law with its arrays, fed with samples."""

    def __init__(self, hold: float = 0.5) -> None:
        file = KeptFile(Path("p07.json"), json.dumps(MADE).encode())
        self.law = EmgActivation("emg", EmgActivationConfig(calibration=file, block=BLOCK, hold=hold))
        self.input = {"samples": np.zeros((BLOCK, 2)), "count": np.zeros(1)}
        self.output = {"activation": np.full(2, np.nan)}
        self.law.bind(self.input, self.output, {}, {})
        self.law.reset()

    def cycle(self, samples: Array) -> Array:
        """One cycle that brings these samples (m, 2)."""
        if len(samples):
            kept = np.concatenate([self.input["samples"], samples])[-BLOCK:]
            self.input["samples"][:] = kept
            self.input["count"][0] += len(samples)
        self.law.update(DT)
        found: Array = self.output["activation"].copy()
        return found


def noise(seconds: float, rms: float, seed: int = 1) -> Array:
    """(k, 2) V, white in the band and out of it; its envelope is about 0.53 of `rms`."""
    return np.random.default_rng(seed).normal(scale=rms, size=(round(2000 * seconds), 2))


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(0, BLOCK), min_size=40, max_size=40))
def test_it_is_the_toolkit_s_envelope_however_cycles_split_the_samples(sizes: list[int]) -> None:
    samples = noise(1.5, 1e-4) + 1e-3  # an electrode's offset has no effect
    worn, at = Worn(), 0
    for size in sizes:
        found = worn.cycle(samples[at : at + size])
        at += size
    if at <= 400 or not sizes[-1]:
        return
    wanted = semg.normalise(semg.OnlineEnvelope(2, Filters(2000.0)).take(samples[:at])[-1:] - REST, [MVC - REST] * 2)
    np.testing.assert_allclose(found, np.clip(wanted[0], 0.0, 1.0), rtol=1e-9)


def test_rest_is_zero_and_the_greatest_contraction_one() -> None:
    for rms, low, high in ((3e-6, 0.0, 0.001), (3.75e-4, 0.35, 0.65), (3e-3, 1.0, 1.0)):
        worn, samples = Worn(), noise(1.0, rms)
        found = [worn.cycle(samples[at : at + 20]) for at in range(0, 2000, 20)]
        assert (np.array(found[:19]) == 0.0).all()  # until the filters have settled
        assert low <= np.mean(found[60:]) <= high
        assert worn.law.metrics()["gaps"] == 0


def test_it_settles_after_a_step_within_a_quarter_of_a_second() -> None:
    worn, samples = Worn(), np.concatenate([noise(0.5, 3e-6), noise(1.0, 6e-4)])
    found = np.array([worn.cycle(samples[at : at + 20])[0] for at in range(0, 3000, 20)])
    assert found[49] < 0.01
    assert found[50:75].max() > 0.6


def broken(worn: Worn, how: str, samples: Array) -> None:
    """Something happens to the samples for one cycle."""
    if how == "too many":
        worn.input["count"][0] += BLOCK + 1
    elif how == "began anew":
        worn.input["count"][0] = 5
    elif how == "not a number":
        worn.input["samples"][-1, 1] = np.nan
    elif how == "out of reach":
        samples = samples.copy()
        samples[:, 1] = 0.0
    worn.cycle(samples)


@pytest.mark.parametrize("how", ["too many", "began anew", "not a number", "out of reach"])
def test_where_samples_are_missing_the_last_activation_stands_and_then_the_limb_stops(how: str) -> None:
    worn, samples = Worn(), noise(4.0, 3.75e-4)
    for at in range(0, 2000, 20):
        before = worn.cycle(samples[at : at + 20])
    assert before.min() > 0.2
    assert not worn.law.lost
    for at in range(2000, 2000 + 48 * 20, 20):
        broken(worn, how, samples[at : at + 20])
        np.testing.assert_array_equal(worn.output["activation"], before)
        assert not worn.law.lost
    for at in range(3000, 3000 + 4 * 20, 20):
        broken(worn, how, samples[at : at + 20])
    assert worn.law.lost
    worn.input["samples"][:] = samples[:BLOCK]
    for at in range(4000, 4800, 20):
        found = worn.cycle(samples[at : at + 20])
    assert not worn.law.lost
    assert (found != before).all()
    assert worn.law.metrics()["gaps"] == 1


def test_cycles_without_new_samples_are_no_gap_until_they_last() -> None:
    worn, samples = Worn(), noise(1.0, 3.75e-4)
    for at in range(0, 2000, 27):
        before = worn.cycle(samples[at : at + 27])
        np.testing.assert_array_equal(worn.cycle(samples[:0]), before)
    assert not worn.law.lost
    for _ in range(51):
        worn.cycle(samples[:0])
    assert worn.law.lost


def test_a_reset_forgets_what_was_before() -> None:
    worn, samples = Worn(), noise(1.0, 3e-3)
    for at in range(0, 1000, 20):
        worn.cycle(samples[at : at + 20])
    worn.law.reset()
    assert (worn.output["activation"] == 0.0).all()
    assert (worn.cycle(samples[1000:1020]) == 0.0).all()


def test_samples_of_rows_are_joined_or_known_to_be_missing() -> None:
    blocks = np.arange(24.0).reshape(3, 4, 2)
    counts = np.array([10.0, 12.0, 16.0])
    found = joined_samples(blocks, counts)
    assert found is not None
    np.testing.assert_array_equal(found, np.concatenate([blocks[1, 2:], blocks[2]]))
    for wrong in ([10.0, 15.0, 16.0], [10.0, 9.0, 10.0], [10.0, np.nan, 12.0]):
        assert joined_samples(blocks, np.array(wrong)) is None


def test_the_law_and_the_toolkit_share_their_processing() -> None:
    shared: tuple[tuple[Any, Any], ...] = ((semg.OnlineEnvelope, OnlineEnvelope), (semg.Filters, Filters))
    assert all(one is other for one, other in shared)
