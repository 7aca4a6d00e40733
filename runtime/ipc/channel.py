"""The channel from the loop's process to its supervisor: JSON messages, some with a file descriptor."""

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
        """Sends a message and, with it, a duplicate of `descriptor`. Never blocks.

        It is no error here if the supervisor has ended or hangs.
        """
        try:
            socket.send_fds(
                self.socket,
                [json.dumps(content).encode()],
                [] if descriptor is None else [descriptor],
                socket.MSG_DONTWAIT,
            )
        except OSError:
            pass  # the loop gets a signal when the supervisor dies

    def receive(self) -> tuple[dict[str, Any], int | None] | None:
        """The next message and its descriptor; None once the other end is closed."""
        try:
            data, descriptors, _, _ = socket.recv_fds(self.socket, _MOST, 1)
        except OSError:
            data = b""
        if not data:
            return None
        return json.loads(data), descriptors[0] if descriptors else None
