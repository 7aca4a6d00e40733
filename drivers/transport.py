"""Byte links to devices, named by URL; non-blocking, and never with a queue of commands behind them.

    /dev/ttyUSB0, a pty's path    a serial port: 8N1, no flow control, exclusively locked
    tcp://HOST:PORT               a TCP connection, without Nagle's delay, lost after 2 s without an answer
    tcp-listen://HOST:PORT        the same with a device that dials in; HOST is this host's address, or 0.0.0.0
    spy:FILE:URL                  the link URL, with a readable log of both directions in FILE
    loop://                       an echo: what is written is read back
    loop://NAME                   the first and the second opener of NAME get the two ends of one link

A dead link holds back one command: `write` refuses the next. What the kernel can't tell: TCP counts
bytes as sent once the peer's kernel has them, and a pty reports no unsent bytes at all. A peer that is
reachable but no longer reads therefore swallows commands up to the size of its own buffer (a pty's: 20 KB)
before `write` refuses; only an answer in the device's own protocol shows that sooner.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import glob
import os
import select
import socket
import struct
import termios
import time
from abc import ABC, abstractmethod
from typing import NoReturn
from urllib.parse import urlsplit

import serial

from drivers.listening import await_caller
from runtime.contracts.errors import DeviceError, DeviceLostError

CHUNK = 65536
CHUNKS = 16  # in one read, so that a flood can't hold the loop
LINGER = 0.1  # s, what `close` gives the last bytes to leave
TCP_DEAD = 2.0  # s without an acknowledgement after which a TCP link counts as lost
CONNECT = 3.0  # s


def open_transport(url: str, *, place: str, baudrate: int = 115200) -> Transport:
    """Opens a link; may block up to 3 s.

    Args:
        url: see the module's text.
        place: names the device in every error, e.g. "glove".
        baudrate: bit/s, for serial ports.
    Raises:
        DeviceError: no such port, no permission, in use, refused, or not a link at all.
    """
    if url.startswith("spy:"):
        file, _, inner = url.removeprefix("spy:").partition(":")
        if not file or not inner:
            raise DeviceError(place, f"'{url}' isn't spy:FILE:URL", "E.g. spy:glove.log:/dev/ttyUSB0")
        from drivers.spy import Spy

        return Spy(open_transport(inner, place=place, baudrate=baudrate), url, file, place)
    if url.startswith("tcp://"):
        return _open_tcp(url, place)
    if url.startswith("tcp-listen://"):
        return _connected(url, place, await_caller(url, place))
    if url.startswith("loop://"):
        return _open_loop(url, place)
    if "://" in url:
        raise DeviceError(
            place,
            f"no link is called '{url}'",
            "Known: a path, tcp://HOST:PORT, tcp-listen://HOST:PORT, spy:FILE:URL, loop://",
        )
    return _open_serial(url, place, baudrate)


class Transport(ABC):
    """One open link.

    Attributes:
        url: as it was opened.
        place: the device's name for errors.
    """

    def __init__(self, url: str, place: str) -> None:
        self.url = url
        self.place = place
        self._rest = b""  # of a frame of which the kernel took only part

    def read(self) -> bytes:
        """Everything that is there, b"" if nothing; never blocks.

        Raises:
            DeviceLostError: the other end hung up, even where no bytes were expected.
        """
        chunks: list[bytes] = []
        for _ in range(CHUNKS):
            try:
                chunk = self._take()
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
            chunks.append(chunk)
        return chunks[0] if len(chunks) == 1 else b"".join(chunks)

    def write(self, data: bytes) -> bool:
        """Hands one command to the kernel; never blocks.

        Returns:
            True if the command is on its way (a part the kernel didn't take leaves before anything else);
            False if earlier bytes are still unsent: nothing of `data` was kept.
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
        """Bytes written but not yet sent (TCP: not acknowledged). Raises DeviceLostError."""
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
        """Throws away what has arrived. Raises DeviceLostError."""
        while self.read():
            pass

    def close(self) -> None:
        """Closes; gives the last bytes 0.1 s to leave, then discards them. Always succeeds."""
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
        """The descriptor that `write` writes to; -1 once closed."""

    def _read_fileno(self) -> int:
        return self.fileno()

    @abstractmethod
    def _take(self) -> bytes:
        """One read; BlockingIOError where there is nothing, b"" at the end, other OSErrors for a loss."""

    @abstractmethod
    def _give(self, data: bytes) -> int:
        """One write; the number of bytes taken, 0 where there is no room."""

    @abstractmethod
    def _queued(self) -> int:
        """Bytes the kernel still holds."""

    @abstractmethod
    def _shut(self) -> None:
        """Discards what is unsent and closes."""

    def _lost(self, why: str) -> NoReturn:
        raise DeviceLostError(self.place, f"the link {self.url} is gone ({why})", "Check its cable and its power")


class SerialPort(Transport):
    """A tty, opened and configured by pyserial, then used through its descriptor."""

    def __init__(self, url: str, place: str, port: serial.Serial) -> None:
        super().__init__(url, place)
        self._port = port
        self._fd = port.fileno()
        os.set_blocking(self._fd, False)
        # With pyserial's VMIN = 0 "nothing there" and "hung up" both read as b""; with 1 the first is EAGAIN.
        mode = termios.tcgetattr(self._fd)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._fd, termios.TCSANOW, mode)

    def fileno(self) -> int:
        return self._fd

    def _take(self) -> bytes:
        return os.read(self._fd, CHUNK)

    def _give(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0

    def _queued(self) -> int:
        return _ioctl_int(self._fd, termios.TIOCOUTQ)

    def _shut(self) -> None:
        try:
            if self._queued():
                termios.tcflush(self._fd, termios.TCOFLUSH)  # else close() waits 30 s for a stalled port
        finally:
            self._fd = -1
            self._port.close()


class Stream(Transport):
    """A connected stream socket; `reader` differs from `writer` only for an echo."""

    def __init__(self, url: str, place: str, writer: socket.socket, reader: socket.socket | None = None) -> None:
        super().__init__(url, place)
        self._writer = writer
        self._reader = reader or writer
        for end in (self._writer, self._reader):
            end.setblocking(False)

    def fileno(self) -> int:
        return self._writer.fileno()

    def _read_fileno(self) -> int:
        return self._reader.fileno()

    def _take(self) -> bytes:
        return self._reader.recv(CHUNK)

    def _give(self, data: bytes) -> int:
        try:
            return self._writer.send(data) if data else 0
        except BlockingIOError:
            return 0

    def _queued(self) -> int:
        return _ioctl_int(self._writer.fileno(), termios.TIOCOUTQ)  # SIOCOUTQ has the same number

    def _shut(self) -> None:
        try:
            if self._queued():
                # A reset throws the queue away: a stalled link must not deliver old commands on recovery.
                self._writer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        finally:
            self._writer.close()
            self._reader.close()


def _open_serial(path: str, place: str, baudrate: int) -> Transport:
    try:
        port = serial.Serial(path, baudrate, exclusive=True)
    except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
        number = getattr(error, "errno", None)
        if number == errno.ENOENT:
            found = sorted(glob.glob("/dev/ttyUSB*") + glob.glob("/dev/ttyACM*"))
            remedy = f"Ports that exist: {', '.join(found)}" if found else "No /dev/ttyUSB* or /dev/ttyACM* exists"
            raise DeviceError(place, f"there is no port {path}", f"{remedy}; plug the device in") from None
        if number in (errno.EACCES, errno.EPERM):
            raise DeviceError(
                place,
                f"no permission to open {path}",
                "Add the user to the port's group, 'sudo usermod -aG dialout $USER', and log in again",
            ) from None
        if number in (errno.EAGAIN, errno.EBUSY):
            raise DeviceError(
                place, f"{path} is in use by another program", f"'fuser -v {path}' shows which; end it"
            ) from None
        raise DeviceError(
            place, f"{path} can't be opened as a serial port: {error}", "Check the path and the baud rate"
        ) from None
    return SerialPort(path, place, port)


def _open_tcp(url: str, place: str) -> Transport:
    try:
        parts = urlsplit(url)
        host, number = parts.hostname, parts.port
    except ValueError:
        host = number = None
    if not host or not number or parts.path or parts.query:
        raise DeviceError(place, f"'{url}' isn't tcp://HOST:PORT", "E.g. tcp://192.168.1.20:3030")
    try:
        link = socket.create_connection((host, number), timeout=CONNECT)
    except ConnectionRefusedError:
        raise DeviceError(
            place,
            f"{host} refuses a connection on port {number}",
            "Start what should listen there, or correct the port",
        ) from None
    except (socket.gaierror, UnicodeError):  # the second for what can't be a host's name at all
        raise DeviceError(place, f"no host is called '{host}'", "Check the name, or use its address") from None
    except OSError as error:
        why = "no answer" if isinstance(error, TimeoutError) else error.strerror
        raise DeviceError(
            place, f"{host}:{number} can't be reached: {why}", "Check the network, the address and the power"
        ) from None
    return _connected(url, place, link)


def _connected(url: str, place: str, link: socket.socket) -> Transport:
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(TCP_DEAD * 1000))
    return Stream(url, place, link)


_waiting: dict[str, socket.socket] = {}  # second ends of named loops, until someone opens them


def _open_loop(url: str, place: str) -> Transport:
    waiting = _waiting.pop(url, None)
    if waiting is not None:
        return Stream(url, place, waiting)
    one, other = socket.socketpair()
    if url == "loop://":
        return Stream(url, place, one, other)
    _waiting[url] = other
    return Stream(url, place, one)


def _ioctl_int(fd: int, request: int) -> int:
    if fd < 0:
        raise OSError(errno.EBADF, "closed")
    return int(struct.unpack("i", fcntl.ioctl(fd, request, b"\0\0\0\0"))[0])
