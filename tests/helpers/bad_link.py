"""Faults in a link: it takes nothing, half of a frame (of a bus: some of the motors' frames), or each other frame."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable
from typing import Any

import can

from srl.drivers.base import MobileBase
from srl.drivers.canbus import CanLink
from srl.drivers.datagram import Datagrams
from srl.drivers.transport import Transport


class Valve:
    """Sits between a transport and the kernel, so that what a stall does to the transport's own frames is real.

    Attributes:
        shut: takes nothing.
        halve: takes half of the next frame, then shuts.
        every_second: refuses each other frame.
        given, received: bytes through it. refused: how often it took nothing.
        latency: ns for which the adapter holds back what comes, on `clock`.
        link: the transport that it was fitted to last.
    """

    def __init__(self) -> None:
        self.shut = self.halve = self.every_second = False
        self.given = self.received = self.refused = 0
        self.latency = 0
        self.clock: Callable[[], int] = lambda: 0
        self.link: Transport | None = None
        self._held: list[tuple[int, bytes]] = []
        self._refuse = False

    def fit(self, link: Transport) -> Transport:
        """Fits it to a link that was just opened."""
        give, take = link._give, link._take
        self.link, self.given, self.received, self._held = link, 0, 0, []

        def given(data: bytes) -> int:
            self._refuse = self.every_second and not self._refuse
            if self.shut or (data and self._refuse):
                self.refused += 1
                return 0
            if self.halve and len(data) > 1:
                self.halve, self.shut = False, True
                data = data[: len(data) // 2]
            taken = give(data)
            self.given += taken
            return taken

        def taken(most: int) -> bytes:
            if self.latency:
                with contextlib.suppress(BlockingIOError):
                    while data := take(most):
                        self.received += len(data)
                        self._held.append((self.clock() + self.latency, data))
                if not self._held or self._held[0][0] > self.clock():
                    raise BlockingIOError
                due = []
                while self._held and self._held[0][0] <= self.clock():
                    due.append(self._held.pop(0)[1])
                return b"".join(due)
            data = take(most)
            self.received += len(data)
            return data

        link._give, link._take = given, taken  # type: ignore[method-assign]
        return link

    def fit_datagrams(self, link: Datagrams) -> Datagrams:
        """Fits it to datagrams: one that is refused is lost."""
        write = link.write

        def written(data: bytes, peer: Any = None) -> bool:
            self._refuse = self.every_second and not self._refuse
            if self.shut or self._refuse:
                self.refused += 1
                return False
            return write(data, peer)

        link.write = written  # type: ignore[method-assign]
        return link

    def open(self) -> None:
        """Takes everything again."""
        self.shut = self.halve = self.every_second = False


class CanValve:
    """As `Valve`, between a CAN link and its bus: a full queue. A frame goes whole or not at all.

    Attributes:
        halve: takes one more frame, then shuts: of a cycle's frames some motors get theirs.
    """

    def __init__(self) -> None:
        self.shut = self.halve = self.every_second = False
        self.refused = 0
        self._refuse = False

    def fit(self, link: CanLink) -> CanLink:
        """Fits it to a link that was just opened."""
        bus: Any = link._bus
        send = bus.send

        def sent(message: can.Message, timeout: float | None = None) -> None:
            self._refuse = self.every_second and not self._refuse
            if self.shut or self._refuse:
                self.refused += 1
                raise can.CanOperationError("no room")
            if self.halve:
                self.halve, self.shut = False, True
            send(message, timeout)

        bus.send = sent
        return link

    def open(self) -> None:
        """Takes everything again."""
        self.shut = self.halve = self.every_second = False


class Hang:
    """As `Valve`, for a link in a process of its own: shut, that process hangs."""

    def __init__(self) -> None:
        self.every_second, self.refused = False, 0
        self.driver: MobileBase | None = None
        self._refuse = self._shut = False

    def fit(self, driver: MobileBase) -> None:
        """Fits it to a driver that is open."""
        self.driver = driver
        publish = driver._link.publish

        def published(*args: Any) -> bool:
            self._refuse = self.every_second and not self._refuse
            taken = not self._refuse and publish(*args)
            self.refused += not taken
            return taken

        driver._link.publish = published  # type: ignore[method-assign]

    @property
    def shut(self) -> bool:
        return self._shut

    @shut.setter
    def shut(self, shut: bool) -> None:
        assert self.driver is not None
        pid = self.driver._link.pid()
        if pid is not None and shut != self._shut:
            os.kill(pid, signal.SIGSTOP if shut else signal.SIGCONT)
        self._shut = shut

    def open(self) -> None:
        """Takes everything again."""
        self.shut = self.every_second = False
