"""systemd's notification protocol: the loop itself sends READY and WATCHDOG."""

from __future__ import annotations

import os
import socket
import time


class Notifier:
    """Sends notifications to NOTIFY_SOCKET. It does nothing if this variable is not set."""

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
        """Tells systemd that the service is up."""
        self._send(b"READY=1")

    def stopping(self) -> None:
        """Tells systemd that the loop has ended, so that the time until the exit does not count as a hang."""
        self._send(b"STOPPING=1")

    def ping(self) -> None:
        """Tells systemd at intervals that the loop is running. Called once a cycle."""
        if self._every and (now := time.monotonic_ns()) >= self._next:
            self._next = now + self._every
            self._send(b"WATCHDOG=1")

    def _send(self, message: bytes) -> None:
        if self._socket is not None:
            try:
                self._socket.sendto(message, self._address)
            except OSError:
                pass  # systemd's own watchdog handles this
