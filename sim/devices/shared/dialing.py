"""The door of a device that connects to the host by TCP and tries again when the connection is lost."""

from __future__ import annotations

import contextlib
import socket
import struct
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

CHUNK: Final = 65536
_EVERY: Final = 50  # calls of `connected` between two attempts


class DialingDoor:
    """Like `PtyDoor`, but the client listens and the device connects.

    Attributes:
        address: the host's `tcp-listen://...`; "" while closed.
        link: not used here.
        connects: number of successful connections.
        bytes_in, bytes_out, lost: numbers of bytes, counted as in `PtyDoor`.
    """

    def __init__(self, url: str) -> None:
        """`url`: where the host listens; the device always connects on loopback."""
        parts = urlsplit(url)
        host = parts.hostname or ""
        self._target = (host if host.startswith("127.") else "127.0.0.1", parts.port or 0)
        self._url = url
        self.link: Path | None = None
        self.address = ""
        self.connects = self.bytes_in = self.bytes_out = self.lost = 0
        self._socket: socket.socket | None = None
        self._looks = 0

    @property
    def is_open(self) -> bool:
        """Whether the device is switched on."""
        return bool(self.address)

    def open(self) -> None:
        """Switches the device on."""
        self.close()
        self.address, self._looks = self._url, 0

    def close(self) -> None:
        """Disconnects the device: the host sees a reset. Always succeeds."""
        link, self._socket = self._socket, None
        self.address = ""
        if link is not None:
            with contextlib.suppress(OSError):
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            link.close()

    def connected(self) -> bool:
        """Whether the connection is up; if not, tries to connect at every 50th call."""
        if self._socket is None and self.address:
            self._looks += 1
            if self._looks % _EVERY == 1:
                self._dial()
        return self._socket is not None

    def read(self) -> bytes:
        """Bytes that the host has sent, b"" if none; never blocks."""
        chunks: list[bytes] = []
        while self._socket is not None:
            try:
                chunk = self._socket.recv(CHUNK)
            except BlockingIOError:
                break
            except OSError:
                chunk = b""
            if not chunk:
                self._socket.close()
                self._socket = None
                break
            chunks.append(chunk)
            self.bytes_in += len(chunk)
        return b"".join(chunks)

    def write(self, data: bytes) -> None:
        """Sends without blocking; bytes for which there is no room are lost."""
        if not data or self._socket is None:
            return
        try:
            taken = self._socket.send(data)
        except BlockingIOError:
            taken = 0
        except OSError:
            taken = 0
            self._socket.close()
            self._socket = None
        self.bytes_out += taken
        self.lost += len(data) - taken

    def _dial(self) -> None:
        link = socket.socket(socket.AF_INET, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        link.settimeout(0.05)  # on loopback a connection is accepted or refused at once
        try:
            link.connect(self._target)
        except OSError:
            link.close()
            return
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = link
        self.connects += 1
