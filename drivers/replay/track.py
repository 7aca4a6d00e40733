"""One device's samples, as in a recording: the time of arrival, the age at that time, and the values."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts import terms
from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.recording.reader import Recording, read


class Samples:
    """The samples, in order of arrival.

    Attributes:
        signals: the device's states.
        arrived: (k,) int64, ns from the beginning, rising; the cycle that found the sample.
        age: (k,) int64, ns, the sample's age at that time.
        length: ns until it begins anew when it is repeated.
    """

    def __init__(
        self, signals: tuple[Signal, ...], arrived: NDArray[np.int64], age: NDArray[np.int64], values: list[Array]
    ) -> None:
        """`values`: (k, ...) of each signal."""
        self.signals, self.arrived, self.age, self._values = signals, arrived, age, values
        gaps = np.diff(arrived)
        self.length = int(arrived[-1]) + (int(np.median(gaps)) if gaps.size else 10**9)

    def __len__(self) -> int:
        return len(self.arrived)

    def find(self, elapsed: int) -> int:
        """Returns the number of the newest sample that has arrived `elapsed` ns after the beginning; -1 if none."""
        return int(np.searchsorted(self.arrived, elapsed, side="right")) - 1

    def values(self, number: int) -> list[Array]:
        """Returns a sample's values, by signal."""
        return [values[number] for values in self._values]


class Track(Samples):
    """A device's samples in a recording."""

    def __init__(self, recording: Recording, device: str, start: float, place: str) -> None:
        """
        Args:
            recording: the recording.
            device: the device whose states are taken.
            start: s from the recording's first row; samples before it are skipped.
            place: the recording's name, for errors.
        Raises:
            RecordingError: no such device, it has no states, or no sample after `start`.
        """
        fields = recording.states(device)
        if not fields:
            have = [name for name in recording.layout.devices if recording.states(name)]
            raise RecordingError(place, f"it has no states of a device '{device}'", nearest(device, have))
        signals = tuple(_signal(field, device) for field in fields)
        now, stamp = recording.int("now"), recording.int(f"{device}.stamp")
        begin = int(now[0]) + round(start * 1e9)
        new = np.diff(stamp, prepend=-1) > 0
        new &= (now >= begin) & recording.connected(device)
        if not new.any():
            seconds = (int(now[-1]) - int(now[0])) / 1e9
            raise RecordingError(
                place, f"'{device}' gave no sample after {start:g} s of {seconds:.1f} s", "Choose another `start`"
            )
        values = [recording.value(field.name)[new] for field in fields]
        super().__init__(signals, now[new] - int(now[new][0]), now[new] - stamp[new], values)


# What recordings of earlier versions, which named few elements, had by shape.
_EARLIER: Final = {3: terms.POINT, 4: terms.QUATERNION, 7: terms.POSE}
_EARLIER_ROWS: Final = {"pose": terms.POSE, "wrench": terms.WRENCH, "twist": terms.TWIST}


def _signal(field: Field, device: str) -> Signal:
    labels, name = field.labels, field.name.removeprefix(f"{device}.")
    usual = _EARLIER_ROWS.get(name.rpartition(".")[2], ())
    if not labels and field.shape == (len(usual),):
        labels = usual
    rows = field.shape[0] if field.shape else 0
    return Signal(
        name=name,
        shape=field.shape,
        unit=field.unit,
        frame=field.frame,
        labels=labels,
        slots=field.slots or (rows > 1 and not labels),
        components=field.components or tuple(_EARLIER.get(n, tuple(map(str, range(n)))) for n in field.shape[1:]),
        visual=field.visual,  # type: ignore[arg-type]
        links=field.links,
        groups=field.groups,
    )


@lru_cache(maxsize=8)
def load(path: str, device: str, start: float) -> Track:
    """Returns a device's track in a recording. Raises RecordingError."""
    return Track(read(Path(path)), device, start, path)
