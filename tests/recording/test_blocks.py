"""Packed rows: the same bits again, whatever they are, and never other ones from a damaged block."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.recording import make_layout, make_rows
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from srl.runtime.recording.blocks import MOST, kin, pack, unpack

WORDS = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.sampled_from([0, -1, 2**63 - 1, -(2**63), 0x7FF8_0000_0000_0001, 0x7FF0_0000_0000_0000]),
)


@given(
    rows=st.integers(1, 12).flatmap(lambda k: arrays.arrays(np.int64, (k, 5), elements=WORDS)),
    ints=st.integers(0, 5),
    near=st.dictionaries(st.integers(0, 4), st.integers(0, 4)),
    how=st.lists(st.sampled_from(["same", "delayed", "close", ""]), min_size=5, max_size=5),
)
@settings(max_examples=60, deadline=None)
def test_every_bit_comes_back(rows: np.ndarray, ints: int, near: dict[int, int], how: list[str]) -> None:
    for c, kind in enumerate(how):  # columns that are another's in some way, along chains and circles
        other = rows[:, (c * 3 + 1) % 5].copy()
        if kind == "delayed":
            rows[1:, c] = other[:-1]
        elif kind:
            rows[:, c] = other + (kind == "close")
    sequence = np.arange(7, 7 + len(rows))
    found = unpack(pack(sequence, rows, ints, near))
    assert np.array_equal(found[0], sequence)
    assert found[1].tobytes() == rows.tobytes()


def test_a_block_as_long_as_can_be() -> None:
    layout = make_layout(extra=0)
    rows = make_rows(layout, MOST)
    data = pack(np.arange(1, MOST + 1), rows, layout.ints, kin(layout))
    assert unpack(data)[1].tobytes() == rows.tobytes()
    assert len(data) < rows.nbytes / 2


def test_a_guarded_command_is_kept_as_its_difference_from_the_asked_one() -> None:
    layout = make_layout()
    asked, guarded = (layout.ints + layout.fields[f"finger.position_command{n}"].offset for n in ("", ".applied"))
    assert kin(layout) == {guarded + i: asked + i for i in range(4)}
    rows = make_rows(layout, 300)
    rng = np.random.default_rng(3)
    rows[:, asked : asked + 4] = rng.standard_normal((300, 4)).view(np.int64)
    rows[:, guarded : guarded + 4] = rows[:, asked : asked + 4] + rng.integers(0, 9, (300, 4))
    sequence = np.arange(300)
    assert len(pack(sequence, rows, layout.ints, kin(layout))) < len(pack(sequence, rows, layout.ints, {})) - 4000


def test_a_damaged_block_is_never_taken_for_rows() -> None:
    layout = make_layout(extra=2)
    rows = make_rows(layout, 50)
    data = pack(np.arange(50), rows, layout.ints, kin(layout))
    refused = 0
    rng = np.random.default_rng(1)
    for _ in range(150):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        try:
            assert unpack(bytes(damaged))[1].tobytes() == rows.tobytes()  # a bit that nothing depends on
        except ValueError:
            refused += 1
    assert refused > 120
    for cut in range(0, len(data), 97):
        with pytest.raises(ValueError, match=r"."):
            unpack(data[:cut])
