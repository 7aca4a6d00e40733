"""A row's numbers as the channels of a stream: their names, units and values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.profile.plots import indices, pick, split
from srl.runtime.recording.elements import elements

PLACE: Final = "--signals"
OWN: Final = ("cycle", "state", "cause")
"""The first channels: which row it is (so it is found in our own recording), the loop's state, why it stopped."""


@dataclass(frozen=True)
class Channels:
    """The channels of one run.

    Attributes:
        references: what was asked for: a signal, or a part of one, each.
        names: of each channel.
        units: of each channel, as the signals declare them (SI).
        devices: whose signals are among them. Each has a channel DEVICE.age, s: a device that is lost keeps its last
            values, and only its age tells.
    """

    references: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    devices: tuple[str, ...]

    @classmethod
    def of(cls, layout: Layout, references: Sequence[str]) -> Channels:
        """Finds the channels.

        Raises:
            RecordingError: the rows lack a signal, or it lacks an element.
            RequestError: an element is asked for twice.
        """
        found = []
        for reference in references:
            pick(layout, np.zeros((0, layout.width), np.int64), reference, PLACE)
            signal = layout.fields[split(reference)[0]]
            numbers = np.arange(signal.size).reshape(signal.shape)[indices(signal, reference, PLACE)]
            every = elements(signal)
            found += [every[i] for i in np.ravel(numbers)]
        owners = {split(reference)[0].partition(".")[0] for reference in references}
        devices = tuple(name for name in layout.devices if name in owners)
        names = (*OWN, *(f"{name}.age" for name in devices), *(element.name for element in found))
        twice = next((name for name, number in Counter(names).items() if number > 1), None)
        if twice is not None:
            raise RequestError(PLACE, f"'{twice}' is there twice", "Name each signal or element once")
        units = (*("1" for _ in OWN), *("s" for _ in devices), *(element.unit for element in found))
        return cls(tuple(references), names, units, devices)

    def values(self, layout: Layout, rows: Words) -> Array:
        """The values of rows (k, width): (k, channels), in the channels' units; NaN where a signal has no value."""
        own = [layout.header(rows, name)[:, None].astype(float) for name in OWN]
        now = layout.header(rows, "now")
        for device in self.devices:
            stamp = layout.header(rows, f"{device}.stamp")
            own.append(np.where(stamp >= 0, (now - stamp) / 1e9, np.nan)[:, None])
        picked = [pick(layout, rows, reference, PLACE).reshape(len(rows), -1) for reference in self.references]
        return np.hstack([*own, *picked])
