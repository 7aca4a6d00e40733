"""When a sample that bears its sender's time was taken, on the loop's clock."""

from __future__ import annotations

from drivers.devicetime import DeviceTime


class SourceTime:
    """`DeviceTime` of a sender whose stamps are ns and only ever rise.

    A stamp that doesn't rise is a repetition, or comes from a clock that was set back. Neither is fresh: after
    the first nothing needs to be done, after the second the link has to be opened anew.
    """

    def __init__(self) -> None:
        self._time = DeviceTime(1)
        self._last = -1

    def restart(self) -> None:
        """The link was opened anew."""
        self._time.restart()
        self._last = -1

    def stamp(self, source: int, arrived: int) -> int | None:
        """When it was taken, ns on the loop's clock; None if it isn't newer than the one before.

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
        """ns that the newest sample took longer than the fastest one."""
        return self._time.delay
