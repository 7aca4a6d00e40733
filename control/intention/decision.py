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
            release: s for which it must not be seen before it ends.
        """
        self._dwell, self._release = dwell, release
        self.clear()

    def clear(self) -> None:
        """Nothing holds."""
        self.action, self._seen, self._since, self._unseen = NONE, NONE, 0.0, 0.0

    def next(self, seen: int, dt: float, confirmed: bool = True) -> int:
        """Takes what was seen over the last dt s, an action's number or NONE. Returns the action that holds.

        An action begins only where it is `confirmed`.
        """
        self._since = self._since + dt if seen == self._seen else dt
        self._seen = seen
        self._unseen = self._unseen + dt if seen != self.action else 0.0
        if seen not in (self.action, NONE) and confirmed and self._since >= self._dwell - 1e-9:
            self.action, self._unseen = seen, 0.0
        elif self._unseen >= self._release - 1e-9:
            self.action = NONE
        return self.action
