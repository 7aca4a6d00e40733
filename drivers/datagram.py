"""Datagram links to devices, named by URL. They never block.

udp://HOST:PORT     a socket connected to a device: it receives that device's datagrams only
udp://ADDRESS:PORT  with listen=True: bound to an address of this host; udp://:PORT means all addresses
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
from urllib.parse import urlsplit

from srl.runtime.contracts.errors import DeviceError, DeviceLostError

LARGEST = 65536  # bytes
MOST = 256  # datagrams in one read, so that a flood can't block the loop
_RECVERR = 11  # IP_RECVERR of Linux, which the module socket doesn't name
BUFFER = 1 << 20  # bytes that the kernel buffers: a pause of the loop must not lose the newest datagram


def open_datagrams(url: str, *, place: str, listen: bool = False) -> Datagrams:
    """Opens a datagram link.

    Args:
        url: see the module's docstring.
        place: the device's name, used in every error.
        listen: bind to the address instead of connecting to it.
    Raises:
        DeviceError: the URL isn't valid, the host is unknown, or the port is taken.
    """
    host, port = _split(url, place, listen)
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    try:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        if listen:
            link.bind((host, port))
        else:
            link.connect((host, port))
    except (UnicodeError, TypeError):  # it can't be a host name at all
        link.close()
        raise DeviceError(place, f"no host is called '{host}'", "Check the name, or use its address") from None
    except OSError as error:
        link.close()
        if error.errno == errno.EADDRINUSE:
            raise DeviceError(
                place, f"port {port} is taken by another program", f"'ss -ulpn sport = {port}' shows which; end it"
            ) from None
        if isinstance(error, socket.gaierror):
            raise DeviceError(place, f"no host is called '{host}'", "Check the name, or use its address") from None
        raise DeviceError(
            place, f"{url} can't be opened: {error.strerror}", "Check the network, the address and the port"
        ) from None
    return Datagrams(url, place, link)


def open_group(group: str, port: int, local: str, *, place: str) -> Datagrams:
    """Opens a link that receives what is sent to a multicast group, on one network interface.

    Args:
        group: the group's address. port: its port.
        local: this host's address on the network over which it comes.
        place: the device's name, used in every error.
    Raises:
        DeviceError: the port is taken, or the group can't be joined there.
    """
    url = f"udp://{group}:{port}"
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
    try:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # another listener of the group may be there
        link.bind((group, port))  # not to 0.0.0.0, where unicast to this port would come in, too
        link.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + socket.inet_aton(local))
    except OSError as error:
        link.close()
        raise DeviceError(
            place, f"the group {group}:{port} can't be joined on {local}: {error.strerror}", "Check the network"
        ) from None
    return Datagrams(url, place, link)


def route_to(host: str, *, place: str) -> tuple[str, str]:
    """Returns this host's address on the way to another, and the other's address.

    Raises:
        DeviceError: no such host, or no way to it.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as probe:
        try:
            probe.connect((host, 9))  # sends nothing
        except (UnicodeError, socket.gaierror):
            raise DeviceError(place, f"no host is called '{host}'", "Check the name, or use its address") from None
        except OSError as error:
            raise DeviceError(place, f"no way leads to {host}: {error.strerror}", "Check the network") from None
        return str(probe.getsockname()[0]), str(probe.getpeername()[0])


def split_url(url: str, place: str, default: int) -> tuple[str, int]:
    """Host and port of udp://HOST or udp://HOST:PORT. Raises DeviceError: it isn't one."""
    try:
        parts = urlsplit(url)
        good = parts.scheme == "udp" and bool(parts.hostname) and not parts.path and not parts.query
        host, port = parts.hostname or "", parts.port
    except ValueError:
        good, host, port = False, "", None
    if not good:
        raise DeviceError(place, f"'{url}' isn't udp://HOST or udp://HOST:PORT", "E.g. udp://192.168.10.1")
    return host, port or default


def _split(url: str, place: str, listen: bool) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
    except ValueError:
        host, port = "", None
    wrong = parts.scheme != "udp" or port is None or parts.path or parts.query if port is not None else True
    if wrong or (not host and not listen):
        form = "udp://:PORT or udp://ADDRESS:PORT" if listen else "udp://HOST:PORT"
        raise DeviceError(
            place, f"'{url}' isn't {form}", "E.g. udp://:51001" if listen else "E.g. udp://192.168.1.1:49152"
        )
    assert port is not None
    return host, port


class Datagrams:
    """One open link.

    Attributes:
        url: the URL it was opened with.
        place: the device's name for errors.
        peer: (host, port) of the sender of the newest datagram; None before the first.
    """

    def __init__(self, url: str, place: str, link: socket.socket) -> None:
        self.url, self.place = url, place
        self.peer: tuple[str, int] | None = None
        self._socket = link

    @property
    def local(self) -> tuple[str, int]:
        """The local address."""
        host, port = self._socket.getsockname()[:2]
        return host, port

    def connect(self, peer: tuple[str, int]) -> None:
        """Connects to a peer: from now on datagrams are received from it alone, and sent to it."""
        self._socket.connect(peer)

    def notice_refusals(self) -> None:
        """Makes a link that isn't connected report, too, that nobody listens where it has sent to."""
        self._socket.setsockopt(socket.IPPROTO_IP, _RECVERR, 1)

    def read(self) -> list[bytes]:
        """Returns all datagrams that have arrived, oldest first; never blocks.

        Raises:
            DeviceLostError: the kernel found that nobody listens at the peer's address, or the link is closed.
        """
        return [data for data, _ in self.read_from()]

    def read_from(self) -> list[tuple[bytes, tuple[str, int]]]:
        """Like `read`, with each datagram's sender."""
        found: list[tuple[bytes, tuple[str, int]]] = []
        for _ in range(MOST):
            try:
                data, peer = self._socket.recvfrom(LARGEST)
            except BlockingIOError:
                break
            except OSError as error:
                if found:
                    break
                self._lost(error)
            self.peer = peer
            found.append((data, peer))
        return found

    def read_wait(self, timeout_s: float) -> list[bytes]:
        """Like `read`, but waits up to `timeout_s` for the first. Blocks: for `open` only."""
        self.wait(timeout_s)
        return self.read()

    def wait(self, timeout_s: float) -> None:
        """Waits up to `timeout_s` for a datagram. Blocks: for `open` only."""
        poll = select.poll()
        poll.register(self.fileno(), select.POLLIN)
        poll.poll(max(0.0, timeout_s) * 1000)

    def write(self, data: bytes, peer: tuple[str, int] | None = None) -> bool:
        """Sends one datagram (to `peer` if the link isn't connected); never blocks.

        Returns:
            False if the kernel had no room; nothing is kept for later.
        Raises:
            DeviceLostError: nobody listens at the peer's address.
        """
        try:
            if peer is None:
                self._socket.send(data)
            else:
                self._socket.sendto(data, peer)
        except BlockingIOError:
            return False
        except OSError as error:
            if error.errno == errno.ENOBUFS:
                return False
            self._lost(error)
        return True

    def fileno(self) -> int:
        """Returns the file descriptor; -1 once closed."""
        return self._socket.fileno()

    def close(self) -> None:
        """Closes the link. Always succeeds."""
        with contextlib.suppress(OSError):
            self._socket.close()

    def _lost(self, error: OSError) -> None:
        why = "nobody listens there" if isinstance(error, ConnectionRefusedError) else error.strerror
        raise DeviceLostError(self.place, f"the link {self.url} is gone ({why})", "Check its cable and its power")
