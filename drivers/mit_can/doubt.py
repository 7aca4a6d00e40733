"""Whether a CubeMars may have let go, or lost its turn, unseen.

Some firmware slackens after 25 ms of silence and obeys the next frame (sheet can_actuators, section 2.6), and a V3
needs no enabling after a loss of power: either would be pulled back to where it was. So it is damped until it says
where it is.
"""

from __future__ import annotations

from typing import Final

PAUSE: Final = 20_000_000  # ns without a frame for it, after which a CubeMars may have let go


class Doubts:
    """By motor, since when it is doubted, and where it stood then.

    Attributes:
        moved: rad of the shaft by which each was found elsewhere when its doubt ended, by its number.
    """

    def __init__(self, n: int) -> None:
        self._since = [-1] * n  # ns; -1: no doubt
        self._stood = [0.0] * n  # as the drive says it
        self.moved: dict[int, float] = {}

    def forget(self, i: int) -> None:
        """It gets no commands any more."""
        self._since[i] = -1
        self.moved.pop(i, None)

    def look(self, i: int, now: int, left: int, heard: int, silent: bool, position: float, most: float) -> bool:
        """Whether motor `i` is to be damped.

        Args:
            i: its number.
            now: ns of this cycle.
            left: ns of the newest frame for it that left.
            heard: ns of its newest reply.
            silent: it has been silent for too long.
            position: rad, what it said last.
            most: rad by which it may be elsewhere and go on; beyond, `moved` says it.
        """
        if self._since[i] < 0 and (silent or now - left > PAUSE):
            self._since[i], self._stood[i] = now, position
        if self._since[i] < 0:
            return False
        if silent or heard <= self._since[i]:
            return True
        away = position - self._stood[i]
        self._since[i] = -1
        if abs(away) > most:
            self.moved[i] = away
            return True
        return False
