"""The interface of a byte link: what `srl.drivers.transport` opens, whatever the medium."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import select
import struct
import termios
import time
from abc import ABC, abstractmethod
from typing import NoReturn

from srl.runtime.contracts.errors import DeviceError, DeviceLostError

CHUNK = 65536
FEW = 4096  # bytes of the first read, and mostly the only one: room for CHUNK costs more than the read itself
CHUNKS = 16  # in one read, so that a flood can't block the loop
LINGER = 0.1  # s that `close` waits for the last bytes to leave


class Transport(ABC):
    """One open link.

    Attributes:
        url: the URL it was opened with.
        place: the device's name for errors.
    """

    _short_is_last = False  # whether a read that gives less than it may has given all there was

    def __init__(self, url: str, place: str) -> None:
        self.url = url
        self.place = place
        self._rest = b""  # the rest of a frame that the kernel took only in part

    def read(self) -> bytes:
        """Returns all bytes that have arrived, b"" if none; never blocks.

        Raises:
            DeviceLostError: the other end hung up, even where no bytes were expected.
        """
        chunks: list[bytes] = []
        for _ in range(CHUNKS):
            most = CHUNK if chunks else FEW
            try:
                chunk = self._take(most)
            except BlockingIOError:
                break
            except OSError as error:
                if chunks:
                    break
                self._lost(error.strerror or str(error))
            if not chunk:
                if chunks:
                    break  # the next read finds the end again
                self._lost("the other end hung up")
            if self._short_is_last and len(chunk) < most == FEW:
                return chunk  # later ones read on: a sender whose window was shut goes on meanwhile
            chunks.append(chunk)
        return chunks[0] if len(chunks) == 1 else b"".join(chunks)

    def write(self, data: bytes) -> bool:
        """Passes one command to the kernel; never blocks.

        Returns:
            True if the command is on its way. A part that the kernel didn't take is sent before anything else.
            False if earlier bytes are still unsent: then nothing of `data` is kept.
        Raises:
            DeviceLostError: the other end hung up.
        """
        try:
            if self._rest:
                self._rest = self._rest[self._give(self._rest) :]
            if self._rest or self._queued():
                return False
            taken = self._give(data)
        except OSError as error:
            self._lost(error.strerror or str(error))
        if taken or not data:
            self._rest = data[taken:]
            return True
        return False

    def unsent(self) -> int:
        """Returns the bytes written but not yet sent (TCP: not acknowledged). Raises DeviceLostError."""
        try:
            return self._queued() + len(self._rest)
        except OSError as error:
            self._lost(error.strerror or str(error))

    def read_wait(self, timeout_s: float) -> bytes:
        """Like `read`, but waits up to `timeout_s` for the first byte. Blocks: for `open` only."""
        poll = select.poll()
        poll.register(self._read_fileno(), select.POLLIN)
        poll.poll(max(0, timeout_s) * 1000)
        return self.read()

    def write_all(self, data: bytes, timeout_s: float) -> None:
        """Writes all of `data`. Blocks: for `open` only. Raises DeviceError after `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        accepted = self.write(data)
        while not accepted or self._rest:
            if time.monotonic() > deadline:
                raise DeviceError(
                    self.place,
                    f"{self.url} took no {len(data)} bytes within {timeout_s:g} s",
                    "Check that the device has power and isn't held by flow control; plug it in again",
                )
            time.sleep(0.001)
            if accepted:
                self.write(b"")
            else:
                accepted = self.write(data)

    def flush_input(self) -> None:
        """Discards the bytes that have arrived. Raises DeviceLostError."""
        while self.read():
            pass

    def close(self) -> None:
        """Closes the link. Waits 0.1 s for the last bytes to leave, then discards them. Always succeeds."""
        deadline = time.monotonic() + LINGER
        with contextlib.suppress(OSError, ValueError, DeviceError):
            while time.monotonic() < deadline and self.unsent():
                self.write(b"")
                time.sleep(0.001)
        self._rest = b""
        with contextlib.suppress(OSError, ValueError, termios.error):
            self._shut()

    @abstractmethod
    def fileno(self) -> int:
        """Returns the file descriptor that `write` uses; -1 once closed."""

    def _read_fileno(self) -> int:
        return self.fileno()

    @abstractmethod
    def _take(self, most: int) -> bytes:
        """Reads once, at most so many bytes. BlockingIOError if there is nothing, b"" at the end, else OSError."""

    @abstractmethod
    def _give(self, data: bytes) -> int:
        """Writes once. Returns the number of bytes taken, 0 if there is no room."""

    @abstractmethod
    def _queued(self) -> int:
        """Returns the number of bytes that the kernel still holds."""

    @abstractmethod
    def _shut(self) -> None:
        """Discards unsent bytes and closes."""

    def _lost(self, why: str) -> NoReturn:
        raise DeviceLostError(self.place, f"the link {self.url} is gone ({why})", "Check its cable and its power")


def ioctl_int(fd: int, request: int) -> int:
    """Returns the integer result of an ioctl on a descriptor. Raises OSError, also if it is closed."""
    if fd < 0:
        raise OSError(errno.EBADF, "closed")
    return int(struct.unpack("i", fcntl.ioctl(fd, request, b"\0\0\0\0"))[0])
