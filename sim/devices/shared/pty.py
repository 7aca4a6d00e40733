"""The door of a twin behind a pty: the device's end of a serial line."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import termios
import tty
from pathlib import Path

from srl.runtime.contracts.errors import HostError

CHUNK = 4096


class PtyDoor:
    """The device's end of a pty; clients may open, close and reopen the other end.

    Like a UART it has no memory of its own. When the kernel's buffer is full, bytes that the client doesn't read
    are lost. Bytes sent while no client has the port open are never received.

    Attributes:
        address: the path of the client's end: `link`, or /dev/pts/N; "" while closed.
        connects: how often a client opened the port while no other had it open. This is polled: a client that
            closes and reopens the port between two calls of `connected` is counted once.
        bytes_in: number of bytes received from clients.
        bytes_out: number of bytes passed to clients.
        lost: number of bytes that a client was too slow to read.
    """

    def __init__(self, link: Path | None = None) -> None:
        """`link`: a symlink that is kept pointing at the client's end, whose own number changes."""
        self.link = link
        self.address = ""
        self.connects = 0
        self.bytes_in = 0
        self.bytes_out = 0
        self.lost = 0
        self._fd = -1
        self._path = ""
        self._there = False
        self._poll = select.poll()

    @property
    def is_open(self) -> bool:
        """Whether there is a port that clients can open."""
        return self._fd >= 0

    def open(self) -> None:
        """Creates the port.

        Raises:
            HostError: no pty is available, or `link` can't be created because something else has that path.
        """
        self.close()
        try:
            master, client = pty.openpty()
        except OSError as error:
            raise HostError("pty", f"the system gives none: {error.strerror}", "Close other terminals") from None
        try:
            tty.setraw(client)  # raw mode lasts as long as the device's end is open
            os.set_blocking(master, False)
            path = os.ttyname(client)
            self._point(path)
        except BaseException:
            os.close(master)
            raise
        finally:
            os.close(client)  # from here on, poll reports whether a client has it open
        self._fd = master
        self._path = path
        self._there = False
        self._poll = select.poll()
        self._poll.register(master, select.POLLIN)
        self.address = str(self.link) if self.link else path

    def close(self) -> None:
        """Removes the port, as unplugging the cable does: the client's descriptor hangs up. Always succeeds."""
        if self._fd < 0:
            return
        if self.link is not None:
            with contextlib.suppress(OSError):
                self.link.unlink()
        with contextlib.suppress(OSError):
            os.close(self._fd)
        self._fd = -1
        self._there = False
        self.address = ""

    def connected(self) -> bool:
        """Whether a client has the port open now."""
        hung_up = self._fd < 0 or any(event & select.POLLHUP for _, event in self._poll.poll(0))
        if self._there and hung_up and self._fd >= 0:
            self._forget_unread()
        if not self._there and not hung_up:
            self.connects += 1
        self._there = not hung_up
        return self._there

    def read(self) -> bytes:
        """Bytes that the client has sent, b"" if none; never blocks."""
        chunks = []
        # Asked first, as there is mostly nothing: an exception costs more than the question.
        while self._fd >= 0 and any(event & select.POLLIN for _, event in self._poll.poll(0)):
            try:
                chunk = os.read(self._fd, CHUNK)
            except OSError:  # EAGAIN: no data; EIO: no client
                break
            chunks.append(chunk)
            self.bytes_in += len(chunk)
        return b"".join(chunks)

    def write(self, data: bytes) -> None:
        """Sends without blocking; bytes for which the client's side has no room are lost."""
        if not data or not self._there:
            return
        try:
            taken = os.write(self._fd, data)
        except OSError:
            taken = 0
        self.bytes_out += taken
        self.lost += len(data) - taken

    def _forget_unread(self) -> None:
        """Discards what the last client hasn't read, so that the next one doesn't receive it."""
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(self._fd, termios.TCOFLUSH)  # bytes in transit; arrived ones belong to the client's end
            end = os.open(self._path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflush(end, termios.TCIFLUSH)
            finally:
                os.close(end)

    def _point(self, path: str) -> None:
        if self.link is None:
            return
        try:
            if self.link.is_symlink():
                self.link.unlink()
            self.link.symlink_to(path)
        except OSError as error:
            raise HostError(
                str(self.link),
                f"the link to the twin's port can't be made: {error.strerror}",
                "Name a folder where this name is free and writable",
            ) from None
