"""What drivers share that reach their device by the option `port`: errors that name it, and the life of one link."""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from typing import Any, Generic, Protocol, TypeVar

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError


class Closable(Protocol):
    """Any link: bytes, datagrams, CAN, events."""

    def close(self) -> None:
        """Closes the link. Always succeeds."""


LinkT = TypeVar("LinkT", bound=Closable)


class Addressed(Driver):
    """A driver whose errors name its `port`, too."""

    def __init__(self, name: str, config: Any) -> None:
        super().__init__(name, config)
        self._place = f"{name} ({config.port})"

    def _error(self, problem: str, remedy: str) -> DeviceError:
        """The error to raise: something is wrong with this device."""
        return DeviceError(self._place, problem, remedy)

    def _lost(self, problem: str, remedy: str) -> DeviceLostError:
        """Notes that this device is lost; returns the error to raise."""
        self.health.lost(problem)
        return DeviceLostError(self._place, problem, remedy)

    def _not_open(self) -> DeviceLostError:
        """The error to raise: somebody uses this device before it was opened."""
        return DeviceLostError(self._place, "it isn't open", "Open it first")


class Linked(Addressed, Generic[LinkT]):
    """A driver with one link: it is opened and closed with the device, and its loss is noted."""

    def __init__(self, name: str, config: Any) -> None:
        super().__init__(name, config)
        self._link: LinkT | None = None

    @abstractmethod
    def connect(self) -> LinkT:
        """Opens the link. A fake that is the driver itself has another one here. Raises DeviceError."""

    @abstractmethod
    def _set_up(self, link: LinkT) -> None:
        """Identifies the device and starts it. Raises DeviceError, after which the link is closed."""

    @abstractmethod
    def _receive(self, link: LinkT, now: int) -> None:
        """Does what `read` of a driver must. Its DeviceLostError is noted in `health`."""

    def _end(self, link: LinkT) -> None:
        """Tells the device that the link is about to be closed. A DeviceError is ignored."""

    def open(self) -> None:
        self.close()
        link = self._link = self.connect()
        try:
            self._set_up(link)
        except BaseException:
            self.close()
            raise
        self.health.opened()

    def read(self, now: int) -> None:
        link = self._open_link()
        try:
            self._receive(link, now)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise

    def close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            with contextlib.suppress(DeviceError):
                self._end(link)
            link.close()
        self.health.connected = False

    def _open_link(self) -> LinkT:
        """The link. Raises DeviceLostError: it isn't open."""
        if self._link is None:
            raise self._not_open()
        return self._link
