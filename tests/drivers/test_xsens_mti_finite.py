"""What an MTi sends that is no number, or no orientation, is no sample."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import numpy as np
import pytest

from srl.drivers.xsens_mti import XsensMti, XsensMtiConfig, data
from srl.drivers.xsens_mti.protocol import Id, Message, encode
from srl.testing import bound

PERIOD = 10_000_000  # ns
TILT = (np.cos(0.2), np.sin(0.2), 0.0, 0.0)
FORCE, TURN = (0.1, 9.81 * np.sin(0.4), 9.81 * np.cos(0.4)), (0.01, -0.02, 0.03)


class Line:
    """A sensor on a line of its own: each message is read in one cycle, and differs in its last bits."""

    def __init__(self) -> None:
        self.driver = bound(XsensMti("imu", XsensMtiConfig(port="/dev/null")))
        self.driver._link = self  # type: ignore[assignment]
        self._sent, self._count = b"", 0

    def read(self) -> bytes:
        sent, self._sent = self._sent, b""
        return sent

    @property
    def now(self) -> int:
        return 10**12 + self._count * PERIOD

    def cycle(self, orientation: Any = TILT, force: Any = FORCE, turn: Any = TURN) -> None:
        self._count += 1
        x, y, z = turn
        items = {
            data.COUNTER: self._count, data.FINE: self._count * PERIOD // data.TICK, data.QUATERNION: orientation,
            data.ACCELERATION: force, data.TURN: (x, y, z + self._count * 1e-5), data.STATUS: 7,
        }  # fmt: skip
        self._sent = encode(Message(Id.DATA, data.encode(items)))
        self.driver.read(self.now)

    def shown(self) -> dict[str, Any]:
        return {name: state.copy() for name, state in self.driver.state_arrays.items()}


def with_one(values: tuple[float, ...], wrong: float) -> list[tuple[float, ...]]:
    """The values with each of them wrong in turn."""
    return [(*values[:i], wrong, *values[i + 1 :]) for i in range(len(values))]


WRONG = [
    *({"force": values} for wrong in (nan, inf, -inf) for values in with_one(FORCE, wrong)),
    *({"turn": values} for wrong in (nan, inf, -inf) for values in with_one(TURN, wrong)),
    *({"orientation": values} for wrong in (nan, inf, 1e30) for values in with_one(TILT, wrong)),
    {"orientation": (0.0, 0.0, 0.0, 0.0)},
    {"orientation": tuple(0.85 * v for v in TILT)},
    {"orientation": tuple(1.15 * v for v in TILT)},
]


@pytest.mark.parametrize("wrong", WRONG, ids=str)
def test_a_wrong_value_anywhere_is_no_sample(wrong: dict[str, Any]) -> None:
    line = Line()
    for _ in range(5):
        line.cycle()
    good, stamp = line.shown(), line.driver.health.stamp
    assert good["orientation"] == pytest.approx(TILT, abs=1e-6)
    line.cycle(**wrong)
    assert line.driver.health.stamp == stamp
    assert line.driver.health.message
    for name, value in line.shown().items():
        np.testing.assert_array_equal(value, good[name])
    for _ in range(10):
        line.cycle(**wrong)
    assert all(np.isnan(value).all() for value in line.shown().values()), "the last good one is too old by then"
    assert line.driver.health.stamp == stamp
    for _ in range(5):
        line.cycle()
    assert line.driver.health.stamp > stamp
    assert line.driver.health.message == ""
    assert line.shown()["acceleration"] == pytest.approx(FORCE, abs=1e-5)


@pytest.mark.parametrize("length", [0.95, 1.05])
def test_a_length_that_is_a_little_off_is_set_right(length: float) -> None:
    line = Line()
    for _ in range(5):
        line.cycle(tuple(length * v for v in TILT))
    assert line.shown()["orientation"] == pytest.approx(TILT, abs=1e-6)
