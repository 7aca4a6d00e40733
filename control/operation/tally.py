"""What a run's summary says of tasks: how far the tip was from the path, and how long it took."""

from __future__ import annotations

from typing import Final

import numpy as np

_BINS: Final = 1000  # of a millimetre each; what is farther is in the last


class Tally:
    """Counts while a task is done, from the tip's arrival at its path on."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._sum = self._most = 0.0
        self.seconds = self.waited = 0.0
        self.done = self.pauses = self.taught = 0
        self.blocked = 0.0
        self.nearest = float("inf")

    def add(self, error: float, nearest: float, dt: float, waits: bool, blocked: bool) -> None:
        """One cycle on the task: m from the path's place, m to the body."""
        self._bins[min(int(1e3 * error), _BINS - 1)] += 1
        self._sum += error
        self._most = max(self._most, error)
        self.nearest = min(self.nearest, nearest)
        self.seconds += dt
        self.waited += dt * waits
        self.blocked += dt * blocked

    def metrics(self) -> dict[str, object]:
        """By name; mm of the measured tip from the path's place, s on the task."""
        n = int(self._bins.sum())
        p95 = int(np.searchsorted(np.cumsum(self._bins), 0.95 * n)) + 1 if n else 0
        return {
            "done": self.done,
            "taught": self.taught,
            "pauses": self.pauses,
            "seconds": round(self.seconds, 3),
            "waited_s": round(self.waited, 3),
            "blocked_s": round(self.blocked, 3),
            "error_mean_mm": round(1e3 * self._sum / n, 2) if n else None,
            "error_p95_mm": p95 if n else None,
            "error_max_mm": round(1e3 * self._most, 2) if n else None,
            "nearest_m": round(self.nearest, 4) if np.isfinite(self.nearest) else None,
        }
