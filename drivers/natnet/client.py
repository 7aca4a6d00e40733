"""A client of Motive: handshake, names, and the newest frame in each cycle."""

from __future__ import annotations

import time
from typing import Final

from srl.drivers.capture.order import Order
from srl.drivers.datagram import Datagrams, open_datagrams, open_group, route_to, split_url
from srl.drivers.natnet import frame as frames
from srl.drivers.natnet import model as models
from srl.drivers.natnet import protocol
from srl.drivers.natnet.frame import MotiveFrame
from srl.drivers.natnet.model import Model
from srl.drivers.natnet.protocol import MalformedError, Message, ServerInfo
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

ANSWER: Final = 2.0  # s for the server info, the definitions, and a frame, each
REPLY: Final = 0.3  # s for the answer to a request in words, which not every server gives
AGAIN: Final = 0.5  # s after which a question is asked again
QUIET: Final = 500_000_000  # ns without a frame after which Motive may have become another one
SILENT: Final = 2_000_000_000  # ns without a frame after which the link is opened anew
ALIVE: Final = 1_000_000_000  # ns between two signs of life to a unicast server
BROKEN: Final = 10  # frames in a row that can't be read, after which the version is asked for again
_REMEDY: Final = (
    "In Motive's streaming settings enable NatNet and choose the interface of this network; check the firewall of "
    "Motive's computer, and that the port is its command port (1510)"
)


class Client:
    """Attributes:
    frames, errors: frames that came, the late ones too, and datagrams that were none or were cut.
    foreign: datagrams of other senders.
    info, model: what the server said of itself and of its assets; None while it isn't known.
    order: of the frames' numbers.
    rate: Hz, as the server says; None if it doesn't.
    renamed: the definitions are new; the caller resets it.
    """

    def __init__(self, port: str, place: str) -> None:
        self.frames = self.errors = self.foreign = 0
        self.info: ServerInfo | None = None
        self.model: Model | None = None
        self.order = Order(31)
        self.rate: float | None = None
        self.renamed = False
        self._port, self._place = port, place
        self._command: Datagrams | None = None
        self._data: Datagrams | None = None
        self._server = ("", 0)
        self._values: list[float] = []
        self._broken = 0
        self._sure = False  # the server info is of the server that sends now
        self._begin(0)

    def _begin(self, now: int) -> None:
        self._heard = self._asked = self._alive = now

    # -- opening

    def open(self) -> None:
        """Connects, and waits for names and a frame. Blocks. Raises DeviceError."""
        self.close()
        host, port = split_url(self._port, self._place, protocol.COMMAND_PORT)
        local, address = route_to(host, place=self._place)
        self._server = (address, port)
        self.info, self.model, self._sure, self._broken = None, None, False, 0
        self.order.restart()
        # Not connected: in unicast, frames come from the server's other port.
        command = self._command = open_datagrams(f"udp://{local}:0", place=self._place, listen=True)
        command.notice_refusals()
        command.url = f"udp://{address}:{port}"
        try:
            info = self._handshake(command)
            if info.multicast:
                self._data = open_group(info.group, info.data_port, local, place=self._place)
            units = self._ask(command, "UnitsToMillimeters")
            if units is not None and not 999.0 < units < 1001.0:
                raise DeviceError(
                    self._place, f"Motive sends lengths in {units:g} mm, not in metres", "Set its streaming scale to 1"
                )
            self.rate = self._ask(command, "FrameRate")
            self._names(command)
            self._first(command, info)
        except DeviceError:
            self.close()
            raise

    def close(self) -> None:
        """Closes the link. Always succeeds."""
        command, data, self._command, self._data = self._command, self._data, None, None
        for link in (command, data):
            if link is not None:
                link.close()

    def _handshake(self, command: Datagrams) -> ServerInfo:
        heard = ""
        end = time.monotonic() + ANSWER
        while time.monotonic() < end:
            self._send(command, protocol.connect())
            again = time.monotonic() + AGAIN
            while (left := again - time.monotonic()) > 0:
                for message, payload in self._packets(command, left):
                    if message != Message.SERVER_INFO:
                        continue
                    try:
                        self.info = protocol.server_info(payload)
                    except MalformedError as error:
                        heard = str(error)
                        continue
                    self._sure = True
                    return self.info
        host = f"{self._server[0]}:{self._server[1]}"
        if heard:
            raise DeviceError(self._place, f"what answers at {host} isn't a Motive we know: {heard}", _REMEDY)
        raise DeviceError(self._place, f"no Motive answers at {host}", _REMEDY)

    def _ask(self, command: Datagrams, text: str) -> float | None:
        """Asks in words; None if there is no answer. Answers don't say to what: only one question is open at a time."""
        self._values.clear()
        self._send(command, protocol.request(text))
        end = time.monotonic() + REPLY
        while not self._values and (left := end - time.monotonic()) > 0:
            self._serve(self._packets(command, left))
        return self._values[0] if self._values else None

    def _names(self, command: Datagrams) -> None:
        end, again = time.monotonic() + ANSWER, 0.0
        while self.model is None and (left := end - time.monotonic()) > 0:
            if time.monotonic() >= again:
                self._send(command, protocol.REQUEST_MODEL)
                again = time.monotonic() + AGAIN
            self._serve(self._packets(command, min(left, AGAIN)))
        if self.model is None:
            raise DeviceError(self._place, "Motive answers, but doesn't say what it streams", "Restart its streaming")

    def _first(self, command: Datagrams, info: ServerInfo) -> None:
        link = self._data or command
        end = time.monotonic() + ANSWER
        before = self.errors
        while (left := end - time.monotonic()) > 0:
            for message, payload in self._packets(link, left):
                self.frames += message == Message.FRAME
                if message == Message.FRAME and self._decoded(payload) is not None:
                    return
        if self.errors > before:
            problem = f"its frames can't be read as NatNet {info.version}"
            raise DeviceError(self._place, problem, "Report Motive's version; choose an older bitstream version in it")
        where = f"to the group {info.group}:{info.data_port}" if info.multicast else "to this computer (unicast)"
        raise DeviceError(
            self._place,
            f"Motive answers, but no frame comes {where}",
            "Go live in Motive; check the firewall of this computer for that port, and Motive's local interface",
        )

    # -- cycle

    def read(self, now: int) -> MotiveFrame | None:
        """Takes all that has come; returns the newest frame that is newer than the last. Never blocks.

        Raises:
            DeviceLostError: nothing came for 2 s, or the server sends in another way.
        """
        command = self._command
        if command is None:
            raise DeviceLostError(self._place, "it isn't open", "Open it first")
        if not self._heard:
            self._begin(now)
        # What the server says of itself comes first: it decides how the frames are read.
        waiting = self._serve(self._packets(command))
        if self._data is not None:
            waiting += self._serve(self._packets(self._data))
        self._keep_contact(command, now, bool(waiting))
        if not self._sure:
            return None
        newest, restarts = None, self.order.restarts
        for payload in waiting:
            number = self._number(payload)
            self.frames += number is not None
            if number is not None and self.order.is_new(number):
                newest = payload
        if self.order.restarts != restarts:  # it counts anew: it may be another version of Motive, with other names
            self.doubt()
            self.names_again()
            return None
        return None if newest is None else self._decoded(newest)

    def doubt(self) -> None:
        """The server may have become another one: nothing is read until it has said again what it is."""
        self._sure, self._asked = False, 0

    def names_again(self) -> None:
        """Asks for the names again."""
        if self._command is not None:
            self._send(self._command, protocol.REQUEST_MODEL)

    def _keep_contact(self, command: Datagrams, now: int, came: bool) -> None:
        if came:
            self._heard = now
        if now - self._heard > SILENT:
            raise DeviceLostError(self._place, "no frame for 2 s", "Go live in Motive; check the network")
        if now - self._heard > QUIET:
            self._sure = False
        if not self._sure and now - self._asked > AGAIN * 1e9:
            self._asked = now
            self._send(command, protocol.connect())
        if self.info is not None and not self.info.multicast and now - self._alive > ALIVE:
            self._alive = now
            self._send(command, protocol.keep_alive())

    def _send(self, command: Datagrams, data: bytes) -> None:
        command.write(data, self._server)

    def _packets(self, link: Datagrams, wait: float | None = None) -> list[tuple[int, bytes]]:
        """The server's packets; other senders' are counted only: there may be a second Motive on the network."""
        if wait is not None:
            link.wait(wait)
        found = []
        for data, (host, _) in link.read_from():
            if host != self._server[0]:
                self.foreign += 1
                continue
            try:
                found.append(protocol.split(data))
            except MalformedError:
                self.errors += 1
        return found

    def _serve(self, packets: list[tuple[int, bytes]]) -> list[bytes]:
        """Takes what isn't a frame; returns the frames."""
        waiting = []
        for message, payload in packets:
            if message == Message.FRAME:
                waiting.append(payload)
            elif message == Message.RESPONSE:
                if (value := protocol.value(payload)) is not None:
                    self._values.append(value)
            elif message == Message.MODEL:
                self._name(payload)
            elif message == Message.SERVER_INFO:
                self._identify(payload)
        return waiting

    def _identify(self, payload: bytes) -> None:
        try:
            info = protocol.server_info(payload)
        except MalformedError:
            self.errors += 1
            return
        before, self.info, self._sure = self.info, info, True
        if before is None or before == info:
            return
        if (before.multicast, before.group, before.data_port) != (info.multicast, info.group, info.data_port):
            raise DeviceLostError(self._place, "Motive sends in another way now", "It is opened anew")
        self.order.restart()
        self.order.restarts += 1  # whoever was seen upright was so by the axes of the Motive before
        self.names_again()

    def _name(self, payload: bytes) -> None:
        if self.info is None:
            return
        try:
            self.model = models.decode(payload, self.info.version)
        except MalformedError:
            self.errors += 1
            return
        self.renamed = True

    def _number(self, payload: bytes) -> int | None:
        try:
            return frames.number(payload) & 0x7FFFFFFF
        except MalformedError:
            self.errors += 1
            return None

    def _decoded(self, payload: bytes) -> MotiveFrame | None:
        assert self.info is not None
        try:
            found = frames.decode(payload, self.info.version)
        except MalformedError:
            self.frames -= 1
            self.errors += 1
            self._broken += 1
            if self._broken >= BROKEN:
                self._broken = 0
                self.doubt()
            return None
        self._broken = 0
        return found
