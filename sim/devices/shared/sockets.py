"""The doors of twins behind sockets: the device's end of network links to its clients. Loopback only."""

from __future__ import annotations

import contextlib
import fcntl
import select
import socket
import struct
import termios
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Final

from srl.runtime.contracts.errors import HostError
from srl.runtime.contracts.world import Fake, Twin
from srl.sim.devices.shared.windows import Plug

CHUNK: Final = 65536
CHUNKS: Final = 64  # most chunks in one read
_BACKLOG: Final = 8


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """A port of this host that nobody has now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Client:
    """One connection.

    Attributes:
        peer: (host, port) of the client.
        gone: whether the connection has ended.
        lost: number of bytes that the client was too slow to take.
    """

    def __init__(self, link: socket.socket, door: TcpDoor) -> None:
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.peer: tuple[str, int] = link.getpeername()[:2]
        self.gone = False
        self.lost = 0
        self._link, self._door = link, door
        self._arrivals = select.poll()
        self._arrivals.register(link, select.POLLIN)
        self._kept = b""

    def read(self) -> bytes:
        """Bytes that the client has sent, b"" if none; never blocks."""
        if self.gone or not self._arrivals.poll(0):
            return b""
        chunks: list[bytes] = []
        for _ in range(CHUNKS):
            try:
                chunk = self._link.recv(CHUNK)
            except BlockingIOError:
                break
            except OSError:
                self.gone = True
                break
            if not chunk:
                self.gone = True
                break
            chunks.append(chunk)
        data = b"".join(chunks)
        self._door.bytes_in += len(data)
        return data

    def write(self, data: bytes, keep: bool = False) -> None:
        """Sends without blocking.

        If the kernel has no room at all for a frame, the frame is lost and counted. The rest of a frame that was
        begun is kept and sent first. With `keep`, whole frames are kept, too.
        """
        if self.gone:
            return
        if self._kept:
            self._kept = self._kept[self._send(self._kept) :]
        if self._kept:
            if keep:
                self._kept += data
            else:
                self.lost += len(data)
                self._door.lost += len(data)
            return
        taken = self._send(data)
        if taken or keep:
            self._kept = data[taken:]
        else:
            self.lost += len(data)
            self._door.lost += len(data)

    def unsent(self) -> int:
        """Number of bytes not yet acknowledged by the client's kernel."""
        with contextlib.suppress(OSError):
            return len(self._kept) + int(struct.unpack("i", fcntl.ioctl(self._link, termios.TIOCOUTQ, b"\0" * 4))[0])
        return len(self._kept)

    def close(self) -> None:
        """Closes the connection."""
        self.gone = True
        with contextlib.suppress(OSError):
            self._link.close()

    def reset(self) -> None:
        """Closes the connection as a device that loses power does: the client sees a reset."""
        with contextlib.suppress(OSError):
            self._link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close()

    def _send(self, data: bytes) -> int:
        if not data:
            return 0
        try:
            taken = self._link.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self.gone = True
            return 0
        self._door.bytes_out += taken
        return taken


class Door(ABC):
    """A socket of a twin.

    Attributes:
        host: its loopback address.
        port: its port; it stays the same after close and open.
        address: `tcp://HOST:PORT` or `udp://HOST:PORT`; "" while closed.
        bytes_in, bytes_out: bytes received and sent.
        lost: bytes that clients were too slow to take, or for which the kernel had no room.
    """

    kind: ClassVar[socket.SocketKind]
    scheme: ClassVar[str]

    def __init__(self, host: str = "127.0.0.1") -> None:
        """`host`: a loopback address; 127.0.0.2 and so on are loopback, too. Raises HostError: another one."""
        if not host.startswith("127."):
            raise HostError(host, "a twin listens on loopback only", "Use 127.0.0.1")
        self.host = host
        self.address = ""
        self.port = 0
        self.bytes_in = self.bytes_out = self.lost = 0
        self._socket: socket.socket | None = None
        # An eighth of the time of a call in vain, which a twin makes each millisecond.
        self._arrivals = select.poll()

    @property
    def is_open(self) -> bool:
        """Whether clients can reach it."""
        return self._socket is not None

    def open(self, port: int = 0) -> None:
        """Binds the socket; uses the previous port again, if there was one.

        Raises:
            HostError: the port is already in use.
        """
        self.close()
        link = socket.socket(socket.AF_INET, self.kind | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC)
        try:
            self._bind(link, (self.host, port or self.port))
        except OSError as error:
            link.close()
            raise HostError(
                f"{self.host}:{port or self.port}",
                f"a twin can't listen there: {error.strerror}",
                "Choose another port",
            ) from None
        self._socket, self.port = link, link.getsockname()[1]
        self._arrivals = select.poll()
        self._arrivals.register(link, select.POLLIN)
        self.address = f"{self.scheme}://{self.host}:{self.port}"

    @abstractmethod
    def _bind(self, link: socket.socket, address: tuple[str, int]) -> None:
        """Raises OSError."""

    def close(self) -> None:
        """Closes the socket. Always succeeds."""
        link, self._socket = self._socket, None
        self.address = ""
        if link is not None:
            link.close()


class TcpDoor(Door):
    """A listening socket and its clients; see `Door`.

    Attributes:
        clients: the connected clients.
        connects: number of clients so far.
    """

    kind, scheme = socket.SOCK_STREAM, "tcp"

    def __init__(self, host: str = "127.0.0.1", most: int = 4) -> None:
        """`most`: most clients at a time; further ones are rejected."""
        super().__init__(host)
        self.most, self.connects = most, 0
        self.clients: list[Client] = []

    def _bind(self, link: socket.socket, address: tuple[str, int]) -> None:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        link.bind(address)
        link.listen(_BACKLOG)

    def accept(self) -> list[Client]:
        """Accepts new clients and removes those that have disconnected; returns the new ones."""
        self.clients = [client for client in self.clients if not client.gone]
        new: list[Client] = []
        while self._socket is not None and self._arrivals.poll(0):
            try:
                link, _ = self._socket.accept()
            except OSError:
                break
            try:
                client = Client(link, self)
            except OSError:  # it disconnected before it was accepted
                link.close()
                continue
            if len(self.clients) >= self.most:
                client.close()
                continue
            self.connects += 1
            self.clients.append(client)
            new.append(client)
        return new

    def close(self) -> None:
        """Closes the socket; clients see a reset, as when the cable or the power fails. Always succeeds."""
        for client in self.clients:
            client.reset()
        self.clients = []
        super().close()


class UdpDoor(Door):
    """A bound datagram socket; see `Door`."""

    kind, scheme = socket.SOCK_DGRAM, "udp"

    def _bind(self, link: socket.socket, address: tuple[str, int]) -> None:
        link.bind(address)
        link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.host))  # loopback only

    def read(self) -> list[tuple[bytes, tuple[str, int]]]:
        """Received datagrams and their senders, oldest first; never blocks."""
        found: list[tuple[bytes, tuple[str, int]]] = []
        if (link := self._socket) is None or not self._arrivals.poll(0):
            return found
        for _ in range(256):
            try:
                data, peer = link.recvfrom(CHUNK)
            except BlockingIOError:
                break
            except OSError:  # an earlier datagram had no receiver; that doesn't concern the device
                continue
            self.bytes_in += len(data)
            found.append((data, peer))
        return found

    def write(self, data: bytes, peer: tuple[str, int]) -> None:
        """Sends one datagram without blocking; if there is no room, it is lost."""
        if self._socket is None:
            return
        try:
            self._socket.sendto(data, peer)
            self.bytes_out += len(data)
        except OSError:
            self.lost += len(data)


class SocketTwin(Twin):
    """A twin behind sockets; the subclass owns the doors.

    During the `loss` windows of the fake's options the doors are closed, as with an unplugged cable. `muted`
    leaves them open and discards what is sent, like a device whose program hangs.

    Attributes:
        muted: the device neither obeys nor answers.
        keep_log: whether to store what `log` returns.
    """

    def __init__(self, fake: Fake) -> None:
        super().__init__(fake)
        self.muted = False
        self.keep_log = False
        self._plug = Plug(fake)

    @abstractmethod
    def doors(self) -> list[TcpDoor | UdpDoor]:
        """All doors; the twin's address is that of the first, unless `describe` is overridden."""

    def describe(self) -> str:
        """The value for the profile's `port`, once the doors are open."""
        return self.doors()[0].address

    def opened(self) -> None:
        """Called when the doors were opened (again): the device has just been switched on or plugged in."""

    @abstractmethod
    def work(self, now: int) -> None:
        """Accepts new clients, obeys, answers and sends what is due at `now`; not called while muted."""

    def open(self) -> None:
        for door in self.doors():
            door.open()
        self.address = self.describe()
        self.opened()

    def close(self) -> None:
        """Clients see the link fail. `open` restores it at the same ports."""
        for door in self.doors():
            door.close()
        self.address = ""

    def service(self, now: int) -> None:
        self._plug.follow(self.close, self.open)
        if self.muted:
            for door in self.doors():  # the kernel of a hung device still receives
                if isinstance(door, TcpDoor):
                    for client in door.clients:
                        client.read()
                else:
                    door.read()
            return
        self.work(now)

    def metrics(self) -> dict[str, object]:
        """Connections, bytes in each direction, bytes lost."""
        doors: list[Any] = list(self.doors())
        return {
            "connects": sum(door.connects for door in doors if isinstance(door, TcpDoor)),
            "bytes_in": sum(door.bytes_in for door in doors),
            "bytes_out": sum(door.bytes_out for door in doors),
            "bytes_lost": sum(door.lost for door in doors),
        }
