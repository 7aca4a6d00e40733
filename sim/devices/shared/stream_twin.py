"""What the twins share that send a fake's samples as frames: which are due, and a log of those sent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array
from srl.sim.devices.shared.sensor import SampledFake
from srl.sim.devices.shared.sockets import SocketTwin


class Due:
    """The samples of a fake that haven't been sent yet."""

    def __init__(self, fake: SampledFake, most: int) -> None:
        """`most`: samples that are sent at once, after the device was busy; older ones are dropped."""
        self._fake, self._most = fake, most
        self._last = -1  # number of the newest sample handled

    def begin(self) -> None:
        """Leaves out what was sampled up to now."""
        self._last = self._fake.newest()

    def take(self) -> Iterator[tuple[int, Array]]:
        """Yields each sample that is due, and its number before it. Lost ones are left out."""
        newest = self._fake.newest()
        first = max(min(self._last, newest) + 1, newest - self._most + 1, 0)  # less than before in a restored world
        self._last = newest
        for number in range(first, newest + 1):
            values = self._fake.sample(number) if self._fake.samples.keeps(number) else None
            if values is not None:
                yield number, values


class StreamTwin(SocketTwin):
    """A twin that streams frames.

    Attributes:
        due: the samples to send; they begin anew when the doors open.
    """

    def __init__(self, fake: SampledFake, most: int) -> None:
        """`most`: as in `Due`."""
        super().__init__(fake)
        self.due = Due(fake, most)
        self._taken_at = fake.taken_at
        self._frames = 0
        self._log: list[tuple[int, int, int]] = []

    def opened(self) -> None:
        self.due.begin()

    def sent(self, number: int, frame: int, now: int) -> None:
        """Counts a frame that was sent: `frame`, its number on the wire, has the sample `number`."""
        self._frames += 1
        if self.keep_log:
            self._log.append((now, self._taken_at(number), frame))

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: number of frames sent."""
        return super().metrics() | {"frames": self._frames}

    def log(self) -> dict[str, NDArray[Any]]:
        """`sent_ns` (k,): when each frame was sent. `taken_ns` (k,): its world time. `frame` (k,): its number."""
        sent, taken, frame = np.array(self._log, np.int64).reshape(-1, 3).T
        return {"sent_ns": sent, "taken_ns": taken, "frame": frame}
