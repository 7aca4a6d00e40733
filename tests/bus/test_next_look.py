"""When the bus looks at the ring: as a row to publish is due, and ever more seldom while it doesn't come."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.bus.process import APPENDED, SELDOM, SOON, next_look
from srl.runtime.ipc.header import CYCLE


def _row(cycle: int, write: int) -> np.ndarray:
    row = np.zeros(len(CYCLE), np.int64)
    row[CYCLE.cycle], row[CYCLE.write] = cycle, write
    return row


@given(
    st.integers(0, 10**6), st.integers(1, 50), st.integers(500_000, 20_000_000), st.integers(0, 10**18),
    st.integers(0, 10**9),
)  # fmt: skip
def test_looks_lead_to_the_row_that_is_due(cycle: int, every: int, period: int, write: int, late: int) -> None:
    # However long ago the newest row came, looks follow one another until just after the next row to publish.
    due = write + (every - cycle % every) * period + APPENDED
    now = write + late
    while now < due:
        wait = next_look(_row(cycle, write), every, period, now)
        assert SOON <= wait <= SELDOM
        now += wait
    assert late > due - write or now - due < SOON


@given(st.integers(SOON, 10**10))
def test_a_row_that_is_late_is_looked_for_ever_more_seldom(late: int) -> None:
    wait = next_look(_row(0, 0), 1, SOON, SOON + APPENDED + late)
    assert wait == min(late, SELDOM)
