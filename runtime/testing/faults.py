"""Faults of a simulated device, put between the runtime and its fake: so every fake has them, also somebody else's.

They begin and end when a test says so. What the fakes' own options do (`loss`, `dropout`, `delay`) stays as it is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, RequestError, nearest

FAULTS = {
    "silent": "it is connected and nothing comes any more: the newest sample grows old",
    "frozen": "samples go on coming, and the values in them stay as they were",
    "nan": "samples go on coming, and every value in them is NaN",
    "garbage": "samples go on coming, with other numbers in each: of either sign, from 0.001 to a million",
    "out-of-range": "samples go on coming, and every value in them is a million",
    "wrong-sample": "one sample has values beyond all reason; then all is as before",
    "drifting": "the positions that its commands are about are measured 0.6 rad (m) further off with each second",
    "misreporting": "it reports as sent what wasn't: all is 1 more",
    "late": "samples come `by` seconds after they were taken",
    "clock-jump": "samples go on coming, and their stamps are off by `by` seconds, forward or back",
    "disconnected": "it is gone, as with the cable pulled out, and can't be opened until it is healed",
    "deaf": "it takes no command, as with a link that stalls",
    "refusing": "it is connected and says that it won't move, as after a protective stop",
}
"""What each does, in one line."""
_OF_COMMANDS = ("deaf", "refusing", "drifting", "misreporting")
_CHANGED = ("frozen", "nan", "garbage", "out-of-range", "wrong-sample", "drifting", "late", "clock-jump")
_OF_SAMPLES = ("silent", *_CHANGED)
_TIMED = ("late", "clock-jump")
_HUGE, _ABSURD, _DRIFT = 1e6, 1e12, 0.6


@dataclass(frozen=True)
class Sample:
    """What a driver shows: when it was taken (ns), and the values by state."""

    stamp: int
    values: dict[str, NDArray[np.float64]]


class FaultyDevice:
    """Stands between the runtime and one driver, and lets through what the present fault lets through.

    Attributes:
        kind: the present fault; "" for none.
    """

    def __init__(self, driver: Driver) -> None:
        self.kind = ""
        self._driver, self._by = driver, 0
        self._read, self._write, self._open = driver.read, driver.write, driver.open
        self._own = self._shown = self._sample()
        self._since = -1  # ns, when the fault's first sample came
        self._feedback = {c.feedback for c in driver.commands}
        self._waiting: deque[tuple[int, Sample]] = deque()
        self._random = np.random.default_rng(0)
        driver.read, driver.write, driver.open = self.read, self.write, self.open  # type: ignore[method-assign]

    def begin(self, kind: str, by: float = 0.0) -> None:
        """Begins a fault; one that was there ends.

        Args:
            kind: one of `FAULTS`.
            by: s, of "late" and "clock-jump".
        Raises:
            RequestError: there is no such fault, or the device can't have it.
        """
        place = f"fault of '{self._driver.name}'"
        if kind not in FAULTS:
            raise RequestError(place, f"'{kind}' is none", nearest(kind, FAULTS))
        if (kind in _TIMED) != (0 < abs(by) < inf) or (kind == "late" and by < 0):
            remedy = "Give `by`, in seconds, with 'late' (above 0) and 'clock-jump', and with no other"
            raise RequestError(place, f"`by` is {by:g} s", remedy)
        if kind in _OF_COMMANDS and not self._driver.commands:
            raise RequestError(place, f"it takes no commands, so it can't be {kind}", "Name a device that moves")
        if kind in _OF_SAMPLES and not self._driver.states:
            raise RequestError(place, f"it gives no samples, so it can't be {kind}", "Name a device that gives some")
        self.end()
        self.kind, self._by = kind, round(by * 1e9)
        self._own = self._shown = self._sample()
        self._waiting.clear()
        self._since = -1
        self._random = np.random.default_rng([ord(c) for c in self._driver.name])  # the same run gives the same bits

    def end(self) -> None:
        """Ends the fault, if there is one. A device that was gone waits for the runtime to open it again."""
        if self.kind == "refusing":
            self._driver.health.fault = ""
        if self.kind in _CHANGED:
            self._show(self._own)
        self.kind = ""

    def read(self, now: int) -> None:
        """As the driver's."""
        self._refuse_while_gone()
        if self.kind == "silent":
            return
        if self.kind not in _CHANGED:
            self._read(now)
            self._misreport()
            if self.kind == "refusing":
                self._driver.health.fault = "it refuses to move (a fault of the test)"
            return
        self._show(self._own)  # a fake that has no new sample leaves its arrays as it has left them
        self._read(now)
        fresh = self._sample()
        new, self._own = fresh.stamp != self._own.stamp, fresh
        self._since = now if self._since < 0 else self._since
        if self.kind == "late":
            self._waiting.append((now, fresh))
            while self._waiting and self._waiting[0][0] <= now - self._by:
                self._shown = self._waiting.popleft()[1]
        elif self.kind == "clock-jump":
            self._shown = Sample(fresh.stamp + self._by, fresh.values)
        elif self.kind == "drifting":
            off = _DRIFT * (now - self._since) * 1e-9
            self._shown = Sample(
                fresh.stamp, {n: v + off if n in self._feedback else v for n, v in fresh.values.items()}
            )
        elif self.kind == "wrong-sample":
            wrong = self._since == now
            self._shown = Sample(
                fresh.stamp, {n: np.full_like(v, _ABSURD) if wrong else v for n, v in fresh.values.items()}
            )
        elif self.kind != "garbage" or new:  # garbage stays until the next sample comes
            self._shown = Sample(
                fresh.stamp, {n: self._made(v, self._shown.values[n]) for n, v in fresh.values.items()}
            )
        self._show(self._shown)

    def _made(self, values: NDArray[np.float64], shown: NDArray[np.float64]) -> NDArray[np.float64]:
        """What stands in a sample in place of its values."""
        if self.kind == "frozen":
            return shown
        if self.kind == "garbage":
            signs = self._random.choice((-1.0, 1.0), values.shape)
            return signs * 10 ** self._random.uniform(-3.0, np.log10(_HUGE), values.shape)
        return np.full_like(values, np.nan if self.kind == "nan" else _HUGE)

    def write(self, now: int) -> None:
        """As the driver's."""
        self._refuse_while_gone()
        if self.kind != "deaf":
            self._write(now)
            self._misreport()

    def _misreport(self) -> None:
        if self.kind == "misreporting":
            for values in self._driver.sent_arrays.values():
                np.add(values, 1.0, out=values)  # NaN, where nothing was sent, stays

    def open(self) -> None:
        """As the driver's."""
        if self.kind == "disconnected":
            raise DeviceError(self._driver.name, "it doesn't answer (a fault of the test)", "Heal it")
        self._open()

    def _refuse_while_gone(self) -> None:
        if self.kind == "disconnected":
            self._driver.health.connected = False
            raise DeviceLostError(self._driver.name, "it is gone (a fault of the test)", "Heal it")

    def _sample(self) -> Sample:
        return Sample(self._driver.health.stamp, {n: v.copy() for n, v in self._driver.state_arrays.items()})

    def _show(self, sample: Sample) -> None:
        self._driver.health.stamp = sample.stamp
        for name, values in sample.values.items():
            self._driver.state_arrays[name][...] = values
