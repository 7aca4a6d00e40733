"""The row of a cycle: what is recorded of the simulated world's truth has float32's precision, all else its own."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.row import Row

_LARGEST = float(np.finfo(np.float32).max)
_SMALLEST = float(np.finfo(np.float32).tiny)  # of full precision
_IN_RANGE = st.floats(-_LARGEST, _LARGEST).filter(lambda value: value == 0 or abs(value) >= _SMALLEST)


def _row() -> Row:
    layout = Layout()
    layout.add("glove.position", "state", (3,), "rad")
    layout.add("world.hand_position", "truth", (2, 2), "rad")
    layout.add("world.finger_tip", "truth", (3,), "m")
    layout.add("finger.position_command", "command", (3,), "rad")
    return Row(layout)


@given(arrays(np.float64, 13, elements=_IN_RANGE))
@example(np.full(13, np.nan))
@example(np.full(13, -np.inf))
@example(np.full(13, 1 / 3))
def test_the_truth_is_rounded_as_numpy_rounds_to_float32_but_for_ties(values: np.ndarray) -> None:
    row = _row()
    row.floats[:] = values
    row.round_truth()
    for name, view in row.views.items():
        was = values[row.layout.fields[name].offset :][: view.size].reshape(view.shape)
        if name.startswith("world."):
            single = was.astype(np.float32)
            np.testing.assert_array_equal(view, view.astype(np.float32))
            number = np.isfinite(was)
            # Half way between two, numpy takes the even one; both are as near.
            assert (np.abs(view[number] - was[number]) <= np.abs(single[number] - was[number])).all()
            np.testing.assert_array_equal(view[~number], was[~number])
        else:
            assert view.tobytes() == was.tobytes()
    before = row.words.copy()
    row.round_truth()
    np.testing.assert_array_equal(row.words, before)  # what is rounded stays


def test_without_a_world_nothing_is_rounded() -> None:
    layout = Layout()
    layout.add("glove.position", "state", (3,), "rad")
    row = Row(layout)
    row.floats[:] = 1 / 3
    row.round_truth()
    assert (row.floats == 1 / 3).all()
