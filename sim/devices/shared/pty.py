"""A pty as a twin's door: what the device's end of a serial line sees of its client."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import termios
import tty
from pathlib import Path

from runtime.contracts.errors import HostError

CHUNK = 4096


class PtyDoor:
    """The device's end of a pty; a client may open, leave and open the other end again.

    Like a UART it has no memory of its own: bytes the client doesn't take once the kernel's buffer is full
    are lost, and bytes sent while nobody has the port open are never seen.

    Attributes:
        address: the client's end, a path: `link`, or /dev/pts/N; "" while closed.
        connects: times a client opened the port that nobody had open. Seen by looking: one that leaves and
            comes back between two calls of `connected` counts as the same.
        bytes_in: bytes taken from clients.
        bytes_out: bytes handed to clients.
        lost: bytes a client was too slow to take.
    """

    def __init__(self, link: Path | None = None) -> None:
        """`link`: a symlink to keep pointing at the client's end, whose own number changes."""
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
        """Whether there is a port for clients to open."""
        return self._fd >= 0

    def open(self) -> None:
        """Makes the port.

        Raises:
            HostError: no pty to be had, or `link` is in the way.
        """
        self.close()
        try:
            master, client = pty.openpty()
        except OSError as error:
            raise HostError("pty", f"the system gives none: {error.strerror}", "Close other terminals") from None
        try:
            tty.setraw(client)  # stays so while the device's end is open
            os.set_blocking(master, False)
            path = os.ttyname(client)
            self._point(path)
        except BaseException:
            os.close(master)
            raise
        finally:
            os.close(client)  # from here on the poll tells whether somebody has it open
        self._fd = master
        self._path = path
        self._there = False
        self._poll = select.poll()
        self._poll.register(master, select.POLLIN)
        self.address = str(self.link) if self.link else path

    def close(self) -> None:
        """Takes the port away, as a pulled cable does: the client's descriptor hangs up. Always succeeds."""
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
        """What the client has sent, b"" if nothing; never blocks."""
        chunks = []
        while self._fd >= 0:
            try:
                chunk = os.read(self._fd, CHUNK)
            except OSError:  # EAGAIN: nothing there; EIO: nobody there
                break
            chunks.append(chunk)
            self.bytes_in += len(chunk)
        return b"".join(chunks)

    def write(self, data: bytes) -> None:
        """Sends, and loses what the client's side has no room for; never blocks."""
        if not data or not self._there:
            return
        try:
            taken = os.write(self._fd, data)
        except OSError:
            taken = 0
        self.bytes_out += taken
        self.lost += len(data) - taken

    def _forget_unread(self) -> None:
        """Throws away what the client that left hasn't read; the next one must not get it."""
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(self._fd, termios.TCOFLUSH)  # on its way; what has arrived is the other end's
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
