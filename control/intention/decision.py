"""When an action begins and ends: a class must be the best for a while."""

from __future__ import annotations

from typing import Final

NONE: Final = -1


class Decision:
    """Attributes: `action`, the number of the present one, or NONE."""

    def __init__(self, dwell: float, release: float) -> None:
        """
        Args:
            dwell: s for which an action must be seen before it holds.
            release: s for which it must not be seen before it ends with nothing in its place.
        """
        self._dwell, self._release = dwell, release
        self.clear()

    def clear(self) -> None:
        """Nothing holds."""
        self.action, self._seen, self._since = NONE, NONE, 0.0

    def next(self, seen: int, dt: float) -> int:
        """Takes what was seen over the last dt s, an action's number or NONE. Returns the action that holds."""
        if seen == self._seen:
            self._since += dt
        else:
            self._seen, self._since = seen, dt
        if seen != self.action and self._since >= (self._release if seen == NONE else self._dwell) - 1e-9:
            self.action = seen
        return self.action
