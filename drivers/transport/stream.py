"""Links over a stream socket: TCP in both directions of connecting, and a loop within this process."""

from __future__ import annotations

import socket
import struct
import termios
from urllib.parse import urlsplit

from srl.drivers.transport.base import Transport, ioctl_int
from srl.runtime.contracts.errors import DeviceError

TCP_DEAD = 2.0  # s without an acknowledgement after which a TCP link counts as lost
CONNECT = 3.0  # s


class Stream(Transport):
    """A connected stream socket. `reader` differs from `writer` for an echo only."""

    _short_is_last = True  # a terminal's isn't: it gives a page at a time

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

    def _take(self, most: int) -> bytes:
        return self._reader.recv(most)

    def _give(self, data: bytes) -> int:
        try:
            return self._writer.send(data) if data else 0
        except BlockingIOError:
            return 0

    def _queued(self) -> int:
        return ioctl_int(self._writer.fileno(), termios.TIOCOUTQ)  # SIOCOUTQ has the same number

    def _shut(self) -> None:
        try:
            if self._queued():
                # A reset discards the queue: a stalled link must not deliver old commands when it recovers.
                self._writer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        finally:
            self._writer.close()
            self._reader.close()


def open_tcp(url: str, place: str) -> Transport:
    """Connects to tcp://HOST:PORT. Raises DeviceError."""
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
    except (socket.gaierror, UnicodeError):  # the second one for a string that can't be a host name
        raise DeviceError(place, f"no host is called '{host}'", "Check the name, or use its address") from None
    except OSError as error:
        why = "no answer" if isinstance(error, TimeoutError) else error.strerror
        raise DeviceError(
            place, f"{host}:{number} can't be reached: {why}", "Check the network, the address and the power"
        ) from None
    return connected(url, place, link)


def connected(url: str, place: str, link: socket.socket) -> Transport:
    """Makes a link from a connected TCP socket: no Nagle delay, lost after `TCP_DEAD` without an acknowledgement."""
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(TCP_DEAD * 1000))
    return Stream(url, place, link)


_waiting: dict[str, socket.socket] = {}  # second ends of named loops, until someone opens them


def open_loop(url: str, place: str) -> Transport:
    """Opens an echo, or one end of a named loop."""
    waiting = _waiting.pop(url, None)
    if waiting is not None:
        return Stream(url, place, waiting)
    one, other = socket.socketpair()
    if url == "loop://":
        return Stream(url, place, one, other)
    _waiting[url] = other
    return Stream(url, place, one)
