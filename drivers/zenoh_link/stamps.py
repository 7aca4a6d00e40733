"""Maps the stamps of a sender's clock to the loop's clock."""

from __future__ import annotations

from srl.drivers.devicetime import DeviceTime


class SourceTime:
    """`DeviceTime` for a sender whose stamps are ns and always rise.

    A stamp that doesn't rise is a repetition, or comes from a clock that was set back. Neither is new. After a
    repetition nothing needs to be done; after a clock was set back the link has to be opened again.
    """

    def __init__(self) -> None:
        self._time = DeviceTime(1)
        self._last = -1

    def restart(self) -> None:
        """Forgets the sender's clock, because the link was opened again."""
        self._time.restart()
        self._last = -1

    def stamp(self, source: int, arrived: int) -> int | None:
        """Returns when the sample was taken, ns on the loop's clock; None if it isn't newer than the one before.

        Args:
            source: ns of the sender's clock.
            arrived: ns of ours.
        """
        if source <= self._last:
            return None
        self._last = source
        return self._time.stamp(source, arrived)

    @property
    def delay(self) -> int:
        """ns by which the newest sample was slower than the fastest one."""
        return self._time.delay
