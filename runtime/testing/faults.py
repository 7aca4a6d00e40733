"""Faults of a simulated device, put between the runtime and its fake: so every fake has them, also somebody else's.

They begin and end when a test says so. What the fakes' own options do (`loss`, `dropout`, `delay`) stays as it is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from runtime.contracts.driver import Driver
from runtime.contracts.errors import DeviceError, DeviceLostError, RequestError, nearest

FAULTS = {
    "silent": "it is connected and nothing comes any more: the newest sample grows old",
    "frozen": "samples go on coming, and the values in them stay as they were",
    "nan": "samples go on coming, and every value in them is NaN",
    "late": "samples come `by` seconds after they were taken",
    "disconnected": "it is gone, as with the cable pulled out, and can't be opened until it is healed",
    "deaf": "it takes no command, as with a link that stalls",
    "refusing": "it is connected and says that it won't move, as after a protective stop",
}
"""What each does, in one line."""
_OF_COMMANDS = ("deaf", "refusing")
_OF_SAMPLES = ("silent", "frozen", "nan", "late")


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
        self._waiting: deque[tuple[int, Sample]] = deque()
        driver.read, driver.write, driver.open = self.read, self.write, self.open  # type: ignore[method-assign]

    def begin(self, kind: str, by: float = 0.0) -> None:
        """Begins a fault; one that was there ends.

        Args:
            kind: one of `FAULTS`.
            by: s, of "late".
        Raises:
            RequestError: there is no such fault, or the device can't have it.
        """
        place = f"fault of '{self._driver.name}'"
        if kind not in FAULTS:
            raise RequestError(place, f"'{kind}' is none", nearest(kind, FAULTS))
        if (kind == "late") != (0 < by < inf):
            raise RequestError(place, f"`by` is {by:g} s", "Give `by`, in seconds, with 'late' and with no other")
        if kind in _OF_COMMANDS and not self._driver.commands:
            raise RequestError(place, f"it takes no commands, so it can't be {kind}", "Name a device that moves")
        if kind in _OF_SAMPLES and not self._driver.states:
            raise RequestError(place, f"it gives no samples, so it can't be {kind}", "Name a device that gives some")
        self.end()
        self.kind, self._by = kind, round(by * 1e9)
        self._own = self._shown = self._sample()
        self._waiting.clear()

    def end(self) -> None:
        """Ends the fault, if there is one. A device that was gone waits for the runtime to open it again."""
        if self.kind == "refusing":
            self._driver.health.fault = ""
        if self.kind in ("frozen", "nan", "late"):
            self._show(self._own)
        self.kind = ""

    def read(self, now: int) -> None:
        """As the driver's."""
        self._refuse_while_gone()
        if self.kind == "silent":
            return
        if self.kind not in ("frozen", "nan", "late"):
            self._read(now)
            if self.kind == "refusing":
                self._driver.health.fault = "it refuses to move (a fault of the test)"
            return
        self._show(self._own)  # a fake that has no new sample leaves its arrays as it has left them
        self._read(now)
        self._own = own = self._sample()
        if self.kind == "late":
            self._waiting.append((now, own))
            while self._waiting and self._waiting[0][0] <= now - self._by:
                self._shown = self._waiting.popleft()[1]
        elif self.kind == "frozen":
            self._shown = Sample(own.stamp, self._shown.values)
        else:
            self._shown = Sample(own.stamp, {name: np.full_like(v, np.nan) for name, v in own.values.items()})
        self._show(self._shown)

    def write(self, now: int) -> None:
        """As the driver's."""
        self._refuse_while_gone()
        if self.kind != "deaf":
            self._write(now)

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
