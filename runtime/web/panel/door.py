"""Who connects to a page's server: the connections that others hold never keep a stop out.

A connection costs a descriptor before anybody has shown a key. So each user has a share of them, and all who have
never shown a key have one share together. In a full share the oldest that has shown no key makes room. One that shows
none within PATIENCE ends, whatever it sends.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import pwd
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from srl.runtime.ipc.descriptors import raise_limit

SHARE: Final = 32  # connections of one user: a browser has 6 and a websocket for each tab
USERS: Final = 3  # that have a share of their own
RESERVED: Final = 64  # descriptors for everything else, a stop's own among it
TIMEOUT: Final = 3.0  # s from a connection's beginning until it has shown a key
QUEUE: Final = 4096  # connections that wait in the kernel
TURN: Final = 64  # connections looked at in one turn of the event loop
REPORT_EVERY: Final = 10.0  # s between two events
OTHERS: Final = -1

_HEAD, _BY_FAMILY = struct.Struct("=IHHII"), 20  # nlmsghdr; SOCK_DIAG_BY_FAMILY, of question and answer
_ANY: Final = 0xFFFFFFFF


@dataclass(slots=True)
class _Connection:
    """One that was accepted. `came`: s, CLOCK_MONOTONIC; `share`: the user whose share it is in, or OTHERS."""

    end: socket.socket
    user: int
    share: int
    came: float
    let_in: bool = False  # it has shown the key, the token or the cookie
    over: bool = False
    transport: asyncio.BaseTransport | None = None


class Door:
    """The listening side of one server. All its methods are for the event loop's thread."""

    def __init__(
        self, listener: socket.socket, served: Callable[[], asyncio.BaseProtocol], say: Callable[[str], object]
    ) -> None:
        """
        Args:
            listener: bound, not yet listening.
            served: makes the protocol of an accepted connection.
            say: takes the text of an event.
        """
        self._share = max(2, min(SHARE, (raise_limit() - RESERVED) // (USERS + 1)))
        self._listener, self._served, self._say = listener, served, say
        self._known = {os.geteuid()}
        self._connections: dict[tuple[str, int], _Connection] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._pushed: Counter[int] = Counter()  # by user, those that were ended or turned away since the last event
        self._due = self._reported = 0.0
        self._users = _Users(listener.getsockname())
        listener.setblocking(False)
        listener.listen(QUEUE)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(listener, self._take)

    def let_in(self, transport: asyncio.BaseTransport | None, knows: bool) -> None:
        """It has shown the cookie, or the key or token. `knows`: the latter, so that its user gets a share."""
        one = self._connections.get(transport.get_extra_info("peername")) if transport is not None else None
        if one is None:
            return
        one.let_in = True
        if knows and one.user != OTHERS and len(self._known) < USERS:
            self._known.add(one.user)
        if one.user in self._known:
            one.share = one.user

    def look(self, now: float) -> None:
        """Ends those that have shown no key in time, and tells."""
        if now < self._due:
            return
        self._due = now + 0.1
        for name, one in list(self._connections.items()):
            if one.end.fileno() < 0:
                del self._connections[name]
            elif not one.let_in and now - one.came > TIMEOUT:
                self._end(one)
        if self._pushed and now - self._reported > REPORT_EVERY:
            self._reported = now
            (user, count), total = self._pushed.most_common(1)[0], self._pushed.total()
            self._pushed.clear()
            self._say(
                f"a page's connections are being filled: {total} were ended or turned away, {count} of them of "
                f"{_called(user)}. A stop gets through"
            )

    def close(self) -> None:
        """Takes no more."""
        self._loop.remove_reader(self._listener)
        self._listener.close()
        self._users.close()

    def _take(self) -> None:
        room = max(self._share // 8, 1)  # a newcomer outlives the turns until its request is read
        for _ in range(TURN):
            if not room:
                return
            try:
                made, name = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError:  # no descriptor: somebody else's fault, but room is made here
                self._make_room(None)
                return
            made.setblocking(False)
            user = self._users.of(name)
            share = user if user in self._known else OTHERS
            if not self._make_room(share, user):
                made.close()
                continue
            room -= 1
            self._connections[name] = one = _Connection(made, user, share, time.monotonic())
            task = self._loop.create_task(self._serve(one))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    def _make_room(self, share: int | None, user: int = OTHERS) -> bool:
        """Whether there is room in a share. None: in any."""
        own = [g for g in self._connections.values() if share in (None, g.share) and g.end.fileno() >= 0 and not g.over]
        if share is not None and len(own) < self._share:
            return True
        # Others are turned away, which costs next to nothing. Where the kernel doesn't say who is who, the oldest goes.
        turned_away = share == OTHERS and self._users.known
        oldest = None if turned_away else next((g for g in own if not g.let_in), None)
        if oldest is not None:
            self._end(oldest)
            user = oldest.user
        if user in self._pushed or len(self._pushed) < QUEUE:
            self._pushed[user] += 1
        return oldest is not None

    @staticmethod
    def _end(one: _Connection) -> None:
        one.over = True
        if isinstance(one.transport, asyncio.Transport):
            one.transport.abort()

    async def _serve(self, one: _Connection) -> None:
        if one.over:
            one.end.close()
            return
        with contextlib.suppress(OSError):
            one.transport, _ = await self._loop.connect_accepted_socket(self._served, one.end)
        if one.over:
            self._end(one)


class _Users:
    """Who is at the other end of a connection over loopback, as the kernel says (sock_diag(7)); OTHERS: unknown."""

    def __init__(self, ours: tuple[str, int]) -> None:
        self._ours = ours
        self.known = False  # whether the kernel says who is who
        self._kernel: socket.socket | None = None
        with contextlib.suppress(OSError):
            self._kernel = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW | socket.SOCK_CLOEXEC, 4)
            self._kernel.settimeout(0.1)
            self._kernel.connect((0, 0))

    def of(self, theirs: tuple[str, int]) -> int:
        """The user at this address; OTHERS if the kernel doesn't say."""
        if self._kernel is None:
            return OTHERS
        ports = struct.pack("!HH", theirs[1], self._ours[1])
        ends = b"".join(socket.inet_aton(host).ljust(16, b"\0") for host, _ in (theirs, self._ours))
        asked = struct.pack("=BBBBI", socket.AF_INET, socket.IPPROTO_TCP, 0, 0, _ANY) + ports + ends
        asked += struct.pack("=III", 0, _ANY, _ANY)
        try:
            self._kernel.send(_HEAD.pack(_HEAD.size + len(asked), _BY_FAMILY, 1, 0, 0) + asked)
            answer = self._kernel.recv(4096)
        except OSError:
            return OTHERS
        if len(answer) < 84 or _HEAD.unpack_from(answer)[1] != _BY_FAMILY:
            return OTHERS
        self.known = True
        return int(struct.unpack_from("=I", answer, 80)[0])  # idiag_uid

    def close(self) -> None:
        if self._kernel is not None:
            self._kernel.close()


def _called(user: int) -> str:
    if user == OTHERS:
        return "an unknown user"
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"
