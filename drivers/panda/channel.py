"""The command channel of a session: Connect, then one request after another, without ever blocking for a reply."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from srl.drivers.panda.packets import VERSIONS
from srl.drivers.panda.protocol import Reply, ReplyParser, Status, encode_request
from srl.drivers.panda.requests import Body, Connect
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

ANSWER: Final = 3.0  # s for the reply to Connect
SILENCE: Final = 10_000_000_000  # ns without a reply after which the robot counts as lost
TRIES: Final = 10  # connections: a robot that has just released another client needs a moment
_SYSTEMS: Final = "5 (Panda/FER with system 4.2.1 or later) and 10 (FR3 with system 5.9 or later)"

Then = Callable[[Reply], None]


class Channel:
    """One TCP session with a robot that has accepted Connect.

    Requests are sent one at a time; the next is sent when the last one was answered.

    Attributes:
        version: protocol version that the robot speaks.
        parser: the parser of the replies, with its counts.
    """

    def __init__(self, link: Transport, version: int, number: int) -> None:
        """`number`: the number of the first request."""
        self.version = version
        self.parser = ReplyParser(version)
        self._link = link
        self._number = number
        self._waiting: deque[tuple[Body, Then]] = deque()
        self._open: dict[int, Then] = {}  # requests whose last reply hasn't come yet
        self._asked: int | None = None  # number of the newest request, until its first reply
        self._since: int | None = None

    @property
    def idle(self) -> bool:
        """Whether there is nothing to send, and no first reply to wait for."""
        return not self._waiting and self._asked is None

    def ask(self, body: Body, then: Then) -> None:
        """Sends a request as soon as those before it were answered; `then` gets each of its replies."""
        self._waiting.append((body, then))

    def poll(self, now: int) -> None:
        """Takes replies and sends the next request if it is due. Never blocks.

        Raises:
            DeviceLostError: the robot has closed the session, or doesn't reply.
        """
        data = self._link.read()
        if data:
            for reply in self.parser.feed(data):
                self._take(reply)
        if self._asked is not None:
            self._since = now if self._since is None else self._since
            if now - self._since > SILENCE:
                raise DeviceLostError(
                    self._link.place, "the robot doesn't reply to a request", "Check its state in its web interface"
                )
        elif self._waiting:
            body, then = self._waiting[0]
            if self._link.write(encode_request(self.version, self._number, body)):
                self._waiting.popleft()
                self._open[self._number] = then
                self._asked, self._since = self._number, now
                self._number += 1

    def _take(self, reply: Reply) -> None:
        then = self._open.get(reply.number)
        if reply.number == self._asked:
            self._asked = None
        if then is None:
            return
        if reply.status is not Status.MOTION_STARTED:  # only this status is followed by another reply
            del self._open[reply.number]
        then(reply)

    def close(self) -> None:
        """Ends the session. Always succeeds."""
        self._link.close()


def open_channel(url: str, *, place: str, port: int, version: int) -> Channel:
    """Connects; blocks up to about 10 s. The robot then sends its states to UDP `port` of this host.

    Args:
        url: tcp://HOST:PORT of the robot.
        place: the device's name, used in every error.
        version: protocol version to try first; if the robot speaks another known version, that one is used.
    Raises:
        DeviceError: the robot can't be reached, isn't a Franka robot, or speaks an unknown protocol version.
    """
    for _ in range(TRIES):
        link = open_transport(url, place=place)
        try:
            reply = _connect(link, version, port, place)
        except DeviceLostError:
            link.close()
            time.sleep(0.1)
            continue
        except BaseException:
            link.close()
            raise
        # A robot accepts its own version only; franka-sim accepts any, and says which one it speaks.
        if reply.status is Status.SUCCESS and reply.version in VERSIONS:
            return Channel(link, reply.version, 1)
        link.close()
        if reply.version not in VERSIONS or reply.version == version:
            raise DeviceError(
                place,
                f"the robot speaks FCI protocol {reply.version}; known here are {_SYSTEMS}",
                "Bring the robot to one of these systems",
            )
        version = reply.version
    raise DeviceError(
        place,
        "the robot ends every connection at once",
        "End the other program that controls it, and activate FCI in the robot's web interface",
    )


def _connect(link: Transport, version: int, port: int, place: str) -> Reply:
    link.write_all(encode_request(version, 0, Connect(version, port)), ANSWER)
    parser = ReplyParser(version)
    for left in remaining(ANSWER):
        for reply in parser.feed(link.read_wait(left)):
            if reply.command is Connect:
                return reply
    raise DeviceError(
        place,
        f"{link.url} doesn't answer as a Franka robot",
        "Check that the address is the robot's, that FCI is active and that no other program controls it",
    )
