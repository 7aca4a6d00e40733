"""Whether a CubeMars may have let go, or lost its turn, unseen.

Some firmware slackens after 25 ms of silence and obeys the next frame (sheet can_actuators, section 2.6), and a V3
needs no enabling after a loss of power: either would be pulled back to where it was. So it is damped until it says
where it is.
"""

from __future__ import annotations

from typing import Final

PAUSE: Final = 20_000_000  # ns without a frame for it, after which a CubeMars may have let go


class SilentRelease:
    """Since when a motor may have let go, and where it stood then.

    Attributes:
        moved: rad of the shaft by which it was found elsewhere afterwards; None if it wasn't.
    """

    def __init__(self) -> None:
        self._since = -1  # ns; -1: it has not
        self._stood = 0.0  # as the drive says it
        self.moved: float | None = None

    def forget(self) -> None:
        """It gets no commands any more."""
        self._since, self.moved = -1, None

    def look(self, now: int, transmitted: int, heard: int, silent: bool, position: float, most: float) -> bool:
        """Whether the motor is to be damped.

        Args:
            now: ns of this cycle.
            transmitted: ns of the newest frame transmitted to it.
            heard: ns of its newest reply.
            silent: it has been silent for too long.
            position: rad, what it said last.
            most: rad by which it may be elsewhere and go on; beyond, `moved` says it.
        """
        if self._since < 0 and (silent or now - transmitted > PAUSE):
            self._since, self._stood = now, position
        if self._since < 0:
            return False
        if silent or heard <= self._since:
            return True
        away = position - self._stood
        self._since = -1
        if abs(away) > most:
            self.moved = away
            return True
        return False
