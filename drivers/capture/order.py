"""Numbered datagrams that overtake each other, and a sender that begins to count anew."""

from __future__ import annotations

from typing import Final

RESYNC: Final = 10  # consecutive numbers older than the newest, after which the count has begun anew


class Order:
    """Follows a sender's numbers.

    Attributes:
        late: numbers that came behind a newer one.
        restarts: how often the count began anew.
    """

    def __init__(self, bits: int) -> None:
        """`bits`: the numbers wrap at 2**bits."""
        self.late = self.restarts = 0
        self._wrap = 1 << bits
        self._newest: int | None = None
        self._behind = 0

    def after(self, number: int, other: int) -> bool:
        """Whether a number comes after another."""
        return 0 < (number - other) % self._wrap < self._wrap // 2

    def is_new(self, number: int) -> bool:
        """Takes a number; False for one that isn't newer than the newest: an old sample, or the same again."""
        newest = self._newest
        if newest == number:
            self._behind = 0
            return False
        if newest is not None and not self.after(number, newest):
            self._behind += 1
            if self._behind <= RESYNC:
                self.late += 1
                return False
            self.restarts += 1
        self._newest, self._behind = number, 0
        return True

    def restart(self) -> None:
        """The sender is known to count anew."""
        self._newest, self._behind = None, 0
