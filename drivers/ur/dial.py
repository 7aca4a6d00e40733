"""A TCP connection that is opened, used and closed without ever blocking: for ports that are needed at times."""

from __future__ import annotations

import errno
import os
import socket
from typing import Final

from srl.runtime.contracts.errors import DeviceError

_CHUNK: Final = 65536
_BUSY: Final = (errno.EINPROGRESS, errno.EALREADY)


class Dial:
    """One connection, which is being established or open.

    Attributes:
        place: the device's name for errors.
        door: the name of the port for messages: "dashboard (10.0.0.2:29999)".
    """

    def __init__(self, host: str, port: int, place: str, door: str) -> None:
        """`host` is an address, not a name: looking up a name would block."""
        self.place = place
        self.door = f"{door} ({host}:{port})"
        self._peer = (host, port)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._link = socket.socket(family, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        self._connected = False
        self._check(self._link.connect_ex(self._peer))

    def connected(self) -> bool:
        """Returns whether the connection is established.

        Raises:
            DeviceError: it was refused, or there is no route to the host.
        """
        if not self._connected:
            self._check(self._link.connect_ex(self._peer))
        return self._connected

    def send(self, data: bytes) -> bytes:
        """Sends what the kernel takes; returns the rest. Raises DeviceError."""
        try:
            return data[self._link.send(data) :] if data else data
        except BlockingIOError:
            return data
        except OSError as error:
            raise self._gone(error.strerror) from None

    def read(self) -> bytes:
        """Returns the bytes that have arrived, b"" if none. Raises DeviceError if the other end hung up."""
        try:
            data = self._link.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(error.strerror) from None
        if not data:
            raise self._gone("it hung up")
        return data

    def close(self) -> None:
        """Closes the connection. Always succeeds."""
        self._link.close()

    def _check(self, number: int) -> None:
        if number in (0, errno.EISCONN):
            if not self._connected:
                self._connected = True
                self._link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        elif number not in _BUSY:
            self.close()
            raise DeviceError(
                self.place,
                f"the {self.door} can't be reached: {os.strerror(number)}",
                "Switch the controller on; enable the service at the pendant under Settings > Security > Services",
            )

    def _gone(self, why: str | None) -> DeviceError:
        return DeviceError(self.place, f"the {self.door} is gone: {why}", "Check the network and the controller")
