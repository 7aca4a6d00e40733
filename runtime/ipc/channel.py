"""From the loop's process to its supervisor: JSON messages, with file descriptors where one is handed over."""

from __future__ import annotations

import json
import socket
from typing import Any

_MOST = 1 << 16


class Channel:
    """One end of a socket pair of datagrams."""

    def __init__(self, end: socket.socket) -> None:
        self.socket = end

    def send(self, content: dict[str, Any], descriptor: int | None = None) -> None:
        """Sends a message, and a duplicate of `descriptor` with it; never blocks.

        A supervisor that is gone, or hangs, is no error here.
        """
        try:
            socket.send_fds(
                self.socket,
                [json.dumps(content).encode()],
                [] if descriptor is None else [descriptor],
                socket.MSG_DONTWAIT,
            )
        except OSError:
            pass  # its death reaches the loop as a signal

    def receive(self) -> tuple[dict[str, Any], int | None] | None:
        """The next message and its descriptor; None once the other end is closed."""
        data, descriptors, _, _ = socket.recv_fds(self.socket, _MOST, 1)
        if not data:
            return None
        return json.loads(data), descriptors[0] if descriptors else None
