"""Which rows of EMG samples count as missing."""

from __future__ import annotations

import numpy as np
import pytest

from srl.control.emg.blocks import GONE, Stream
from srl.control.emg.processing import Filters

RATE, BLOCK = 2000.0, 40


def row(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 50e-6, (BLOCK, 2))


def stream() -> Stream:
    made = Stream(2, Filters(rate=RATE))
    for i in range(1, 30):
        made.take(row(i), i * BLOCK)
    assert made.fresh
    return made


@pytest.mark.parametrize("value", [0.0, 3e-3, 11e-3, -11e-3])
def test_a_muscle_whose_samples_stand_is_missing(value: float) -> None:
    made = stream()
    stuck = row(30)
    stuck[:, 1] = value
    assert made.take(stuck, 30 * BLOCK) is None
    assert not made.fresh


def test_fewer_equal_samples_are_a_muscle_at_rest() -> None:
    made = stream()
    quiet = row(30)
    quiet[-(GONE - 1) :, 1] = 1e-6
    assert made.take(quiet, 30 * BLOCK) is not None
    assert made.fresh
