"""systemd's notification protocol: READY and WATCHDOG from the loop itself."""

from __future__ import annotations

import os
import socket
import time


class Notifier:
    """Sends to NOTIFY_SOCKET; does nothing where there is none."""

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        if address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        watchdog = int(os.environ.get("WATCHDOG_USEC", "0")) * 1000
        self._every = watchdog // 4
        self._next = 0

    def ready(self) -> None:
        """The service is up."""
        self._send(b"READY=1")

    def stopping(self) -> None:
        """The loop has ended; what follows is no hang."""
        self._send(b"STOPPING=1")

    def ping(self) -> None:
        """Once a cycle: tells systemd now and then that the loop goes round."""
        if self._every and (now := time.monotonic_ns()) >= self._next:
            self._next = now + self._every
            self._send(b"WATCHDOG=1")

    def _send(self, message: bytes) -> None:
        if self._socket is not None:
            try:
                self._socket.sendto(message, self._address)
            except OSError:
                pass  # systemd's own watchdog then does its work
