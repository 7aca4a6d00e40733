"""One request at a time on a half-duplex bus, without blocking: sent in one cycle, answered in a later one.

An answer has no number that links it to its request, and a kernel, an adapter or a pty may hold bytes back. So after
a request that wasn't answered in full the line is in doubt: it sends a ping, and nothing else until a ping is
answered. Anything that comes before this answer is old and is discarded. The bus is a queue. So by then no earlier
goal can still be on its way, and no old sample can be mistaken for a new one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from srl.drivers.servo_bus.packets import Status
from srl.drivers.servo_bus.units import OnLine
from srl.drivers.transport import Transport

LATENCY: Final = 20_000_000  # ns that adapter and kernel may hold bytes back; an FTDI's timer is 16 ms at worst


@dataclass(slots=True)
class Request:
    """A request and its answers.

    Attributes:
        frame: the instruction packet.
        ids: the servos that must answer.
        size: bytes of data in each answer.
        purpose: for the sender's use.
        sent: ns, when it was sent.
        answers: by id.
    """

    frame: bytes
    ids: tuple[int, ...]
    size: int
    purpose: str = ""
    sent: int = -1
    answers: dict[int, Status] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether all servos have answered."""
        return len(self.answers) == len(self.ids)

    def missing(self) -> list[int]:
        """Returns the servos that haven't answered."""
        return [id for id in self.ids if id not in self.answers]


class Line:
    """A half-duplex bus with one request at a time; see the module's docstring.

    Attributes:
        link: the transport.
        parser: counts frames, errors, resyncs.
        pending: the request that isn't answered yet.
        resyncing: a late answer may still come, so nothing but pings may be sent.
        sent: ns, when something was last sent; -1 at first.
        heard: ns, by id, when each servo last answered.
        timeouts: requests that weren't answered in full.
        unsent: bytes of the newest command that the servos may not have taken.
    """

    def __init__(self, link: Transport, bus: OnLine) -> None:
        self.link = link
        self.parser = bus.parser()
        self.pending: Request | None = None
        self.resyncing = False
        self.sent = -1
        self.heard: dict[int, int] = {}
        self.timeouts = 0
        self.unsent = 0
        self._wire, self._ids = bus.wire, bus.ids
        self._pings = [(id, bus.wire.ping(id)) for id in bus.ids]
        self._turn = 0
        self._pinged: set[int] = set()
        self._next_ping = 0
        self._deadline = 0
        config = bus.config
        self._byte = 10**10 // config.baudrate  # ns
        delay = config.return_delay if config.return_delay is not None else 508e-6
        self._answer = round(delay * 1e9) + self._wire.OVERHEAD * self._byte + 100_000  # ns, without data

    @property
    def free(self) -> bool:
        """Whether a request may be sent."""
        return self.pending is None and not self.resyncing

    def send(self, request: Request, now: int, command: bytes = b"") -> bool:
        """Sends `command` (unacknowledged packets) and the request in one piece; call it only while `free`.

        Returns:
            False if the kernel still holds earlier bytes: then nothing was sent.
        """
        if not self.link.write(command + request.frame):
            return False
        request.sent = self.sent = now
        self.unsent = len(command)
        self.parser.forget()
        sending = (len(command) + len(request.frame)) * self._byte
        answering = len(request.ids) * (self._answer + request.size * self._byte)
        self._deadline = now + sending + answering + LATENCY
        self.pending = request
        return True

    def poll(self, now: int) -> Request | None:
        """Takes what has arrived; returns the request that has now ended, answered or not.

        Raises:
            DeviceLostError: the link is gone.
        """
        if not self.heard:
            self.heard = dict.fromkeys(self._ids, now)
        data = self.link.read()
        if data:
            for status in self.parser.statuses(data):
                self._take(status, now)
        if self.resyncing:
            if now >= self._next_ping:
                self._ping(now)
            return None
        request = self.pending
        if request is None or not (request.complete or now > self._deadline):
            return None
        self.pending = None
        if request.complete:
            self.unsent = 0
        else:
            self.timeouts += 1
            self.resyncing = True
            self._pinged.clear()
            self._ping(now)
        return request

    def silent(self, since: int) -> set[int]:
        """Returns the ids of the servos that haven't answered since `since` (ns), or since the first `poll`."""
        return {id for id, at in self.heard.items() if at < since}

    def _take(self, status: Status, now: int) -> None:
        if self.resyncing:
            if status.id in self._pinged and len(status.data) == self._wire.PING_SIZE:
                self.heard[status.id] = now
                self.resyncing = False
                self.unsent = 0
            return
        request = self.pending
        if request is None or status.id not in request.ids:
            return
        if len(status.data) == request.size or (status.error and not status.data):
            self.heard[status.id] = now
            request.answers[status.id] = status

    def _ping(self, now: int) -> None:
        """Pings the servos in turn: the one that stopped answering may be gone for good."""
        id, frame = self._pings[self._turn]
        self._turn = (self._turn + 1) % len(self._pings)
        if self.link.write(frame):
            self.sent = now
            self._pinged.add(id)
        self._next_ping = now + LATENCY + self._answer + len(frame) * self._byte
