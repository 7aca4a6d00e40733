"""The row of the present cycle: named views into one array of words.

All signal arrays of drivers, controllers and guard are views into it, so recording a cycle is one copy.
"""

from __future__ import annotations

import numpy as np

from runtime.contracts.signals import Array
from runtime.ipc.layout import Layout
from runtime.ipc.words import DEVICE


class Row:
    """The row of the present cycle; see the module's docstring.

    Attributes:
        layout: the meaning of the words.
        words: (width,) int64, the whole payload.
        ints: (layout.ints,) int64: the cycle's words (`CYCLE`), then each device's.
        devices: (devices, len(DEVICE)) int64: the words of each device, a view into `ints`.
        floats: float64, the signals' values.
        views: by signal name, its values in its shape, a view into `floats`.
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
