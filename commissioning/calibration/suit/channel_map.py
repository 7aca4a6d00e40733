"""What a calibration from a suit reads in a run's rows: each joint's rotation and translation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from srl.commissioning.calibration.marks import Indices
from srl.commissioning.calibration.run_channels import RunChannels, words
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout


@dataclass(frozen=True)
class SuitChannelMap(RunChannels):
    """`rotation` (4 n,), `translation` (3 n,) of the suit's joints in the order in which the options name them."""

    rotation: Indices
    translation: Indices

    @classmethod
    def places(cls, layout: Layout, options: Any, place: str) -> tuple[Any, ...]:
        both = (options.rotation, options.translation)
        return tuple(words(layout, list(signals.values()), place) for signals in both)

    def poses(self, floats: Array) -> tuple[Array, Array]:
        """(k, n, 4), (k, n, 3) m: each joint's rotation and translation, from rows' float64 words."""
        n = len(self.options.rotation)
        return floats[:, self.rotation].reshape(-1, n, 4), floats[:, self.translation].reshape(-1, n, 3)
