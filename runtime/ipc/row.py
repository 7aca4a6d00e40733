"""The row of the present cycle: named views into one array of words.

All signal arrays of drivers, controllers and guard are views into it, so recording a cycle is one copy.
"""

from __future__ import annotations

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import DEVICE
from srl.runtime.ipc.layout import Layout

_CUT = 29  # bits of a float64's significand that a float32 hasn't
_HALF, _KEPT = np.int64(1 << (_CUT - 1)), np.int64(-(1 << _CUT))


class Row:
    """The row of the present cycle; see the module's docstring.

    Attributes:
        layout: the meaning of the words.
        words: (width,) int64, the whole payload.
        ints: (layout.ints,) int64: the cycle's words (`CYCLE`), then each device's.
        devices: (devices, len(DEVICE)) int64: the words of each device, a view into `ints`.
        floats: float64, the signals' values.
        views: by signal name, its values in its shape, a view into `floats`.
        truth: int64, the bits of the simulated world's true values, a view into `words`; empty without a world.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.words = np.zeros(layout.width, np.int64)
        self.ints = self.words[: layout.ints]
        self.devices = self.ints[layout.device(0).start :].reshape(-1, len(DEVICE))
        self.floats = self.words[layout.ints :].view(np.float64)
        self.views: dict[str, Array] = {
            f.name: self.floats[f.offset : f.offset + f.size].reshape(f.shape) for f in layout.fields.values()
        }
        # A world's signals stand together: the profile's wiring adds one after the other.
        of = [f for f in layout.fields.values() if f.role == "truth"]
        first, last = (layout.ints + of[0].offset, layout.ints + of[-1].offset + of[-1].size) if of else (0, 0)
        self.truth = self.words[first:last]

    def round_truth(self) -> None:
        """Rounds the simulated world's true values to the precision of float32, 2^-24 of the value.

        A simulation has no more of the truth than that, and the other bits, which follow nothing, would take a third
        of a recording. Infinity stays, and so does NaN as arithmetic makes it: one with all bits set becomes a zero.
        """
        np.add(self.truth, _HALF, out=self.truth)
        np.bitwise_and(self.truth, _KEPT, out=self.truth)
