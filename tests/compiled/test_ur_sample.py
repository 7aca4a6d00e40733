"""A packet of the UR's is converted in C to the same bits as in Python."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from helpers.compiled import ODD, needs_c
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.ur.sample import Sample
from srl.runtime.contracts.compiled import undone

pytestmark = needs_c
SIZES = {"position": 6, "velocity": 6, "effort": 6, "wrench": 6, "pose": 7, "speed_scaling": 1}
turns = st.lists(st.floats(-4, 4), min_size=32, max_size=32)
values = st.lists(st.floats(width=64) | st.sampled_from(ODD), min_size=32, max_size=32)
words = st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 7, st.integers(0, 2**64 - 1))


def body(numbers: list[float], integers: tuple[int, ...]) -> bytes:
    return b"\1" + struct.pack(">32d7iQ", *numbers, *integers)


def in_python() -> Sample:
    sample = Sample()
    sample._take = undone
    return sample


@pytest.mark.slow
@given(st.lists(st.tuples(turns | values, words), min_size=1, max_size=5))
def test_a_sequence_of_packets(packets: list[tuple[list[float], tuple[int, ...]]]) -> None:
    samples = in_python(), Sample()
    states = [{name: np.zeros(size) for name, size in SIZES.items()} for _ in samples]
    samples[0]._filled, samples[0]._fill = states[0], undone
    for numbers, integers in packets:
        outcomes = []
        for sample, arrays in zip(samples, states, strict=True):
            taken = sample.take(body(numbers, integers))
            try:
                sample.fill(arrays, ())
                failed = ""
            except (OverflowError, ValueError) as error:
                failed = type(error).__name__
            outcomes.append((taken, failed, sample.words, sample.timestamp, sample.speed_scaling))
        assert outcomes[0] == outcomes[1]
        for name in SIZES:
            assert states[0][name].tobytes() == states[1][name].tobytes(), name


def test_an_ordinary_packet_is_computed_in_c() -> None:
    sample, arrays = Sample(), {name: np.zeros(size) for name, size in SIZES.items()}
    sample.take(body([0.1] * 32, (0,) * 8))
    sample.fill(arrays, ())
    assert (sample._take(0.0), sample._fill(0.0)) == (0, 0)
