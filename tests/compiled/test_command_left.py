"""What a driver reports as sent comes into the row in C as it does in Python, to the bit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from helpers.compiled import ODD, needs_c
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.contracts.compiled import undone
from srl.runtime.contracts.driver import Driver
from srl.runtime.ipc.header import DEVICE
from srl.runtime.loop.device import Device

pytestmark = needs_c
SIZES = (1, 7, 17)  # the last is for Python
reported = st.sampled_from((np.nan, 0.0, 1.5)) | st.floats(width=64) | st.sampled_from(ODD)
cycles = st.lists(st.tuples(*(st.lists(reported, min_size=size, max_size=size) | st.none() for size in SIZES)))


class Sending:
    """What of a driver is asked here."""

    stop_frames, frames_good_for = Driver.stop_frames, Driver.frames_good_for

    def __init__(self, arrays: dict[str, np.ndarray]) -> None:
        self.sent_arrays = arrays
        self.states, self.state_arrays, self.command_arrays = (), {}, {}


def device(in_c: bool) -> tuple[Device, list[np.ndarray], list[np.ndarray]]:
    found, sent = ([np.full(size, np.nan) for size in SIZES] for _ in range(2))
    commands = [SimpleNamespace(name=f"c{size}", shape=(size,)) for size in SIZES]
    arrays = {command.name: array for command, array in zip(commands, found, strict=True)}
    actuators = [SimpleNamespace(command=c, sent=s) for c, s in zip(commands, sent, strict=True)]
    driver = Sending(arrays)
    words = np.zeros(len(DEVICE), np.int64)
    made = Device(cast(Any, driver), words, cast(Any, actuators), lambda text: None)
    if not in_c:
        made._leave = [undone] * len(SIZES)
    return made, found, sent


@pytest.mark.slow
@given(cycles)
def test_what_left_is_the_same(taken: list[tuple[list[float] | None, ...]]) -> None:
    both = device(True), device(False)
    for values in taken:
        for made, found, _ in both:
            for array, value in zip(found, values, strict=True):
                if value is not None:
                    array[:] = value
            made._take_sent()
        for of_c, of_python in zip(both[0][1] + both[0][2], both[1][1] + both[1][2], strict=True):
            assert of_c.tobytes() == of_python.tobytes()
        assert both[0][0].header.tolist() == both[1][0].header.tolist()
