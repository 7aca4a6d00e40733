"""The driver's end: starts the zenoh process, talks to it over a socket, never waits for it in the loop."""

from __future__ import annotations

import contextlib
import socket
import time
from dataclasses import dataclass
from typing import NoReturn

from srl.drivers.helper_process import HelperProcess, ProcessEndedError
from srl.drivers.zenoh_link import wire
from srl.drivers.zenoh_link.config import PeerConfig
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

MOST = 256  # messages taken in one read
START = 10.0  # s that the process may take to start, besides the connection itself


@dataclass(frozen=True)
class Outlet:
    """A key that commands are published on.

    Attributes:
        key: zenoh's key expression.
        encoding: zenoh's encoding; "" for none.
        stop: the payload that stops the device.
        stamp_at: offset of the header's stamp in the payload (int32 s, uint32 ns), which is filled in on sending.
        attach: whether to send rmw_zenoh's attachment.
    """

    key: str
    encoding: str
    stop: bytes
    stamp_at: int | None = None
    attach: bool = False


class Link:
    """One zenoh session at a time, in a process that stays for the next one.

    After `close` the process waits for another `open`. It ends by itself after a while, or as soon as this
    object or this program is gone.
    """

    def __init__(self, place: str) -> None:
        self.place = place
        self._helper = HelperProcess(place, "srl.drivers.zenoh_link", "zenoh process")
        self._session = 0
        self._open = False
        self._where = ""
        self._sent = self._taken = 0
        self._stop_frames: tuple[bytes, ...] = ()
        # The newest message of each subscription that came during the wait for an answer.
        self._kept: dict[tuple[bool, int], wire.Sample | wire.Token] = {}

    def open(
        self,
        config: PeerConfig,
        subscribe: list[str],
        publish: list[Outlet],
        alive: list[str],
        timeout: float = 2.0,
    ) -> None:
        """Connects. Blocks.

        Args:
            config: the peer and its options.
            subscribe: key expressions; `Sample.source` is the index.
            publish: outlets; `publish`'s `outlet` is the index.
            alive: liveliness tokens to watch; `Token.source` is the index.
            timeout: s for the connection.
        Raises:
            DeviceError: nobody answers there.
        """
        self.close()
        _check(config, self.place)
        self._where = config.port
        self._session = self._session % 60000 + 1
        order = {
            "endpoint": config.endpoint,
            "tls": None if config.tls is None else config.tls.model_dump(),
            "timeout": timeout,
            "subscribe": subscribe,
            "publish": [
                {"key": o.key, "encoding": o.encoding, "stop": o.stop.hex(), "stamp_at": o.stamp_at, "attach": o.attach}
                for o in publish
            ],
            "alive": alive,
        }
        self._helper.ensure()
        self._kept.clear()
        self._sent = self._taken = 0
        self._stop_frames = (wire.simple(b"S", self._session),)
        self._open = True
        try:
            self._tell(wire.simple(b"O", self._session, order))
            self._await_ready(timeout)
        except BaseException:
            self.close()
            raise

    def _await_ready(self, timeout: float) -> None:
        deadline = time.monotonic() + timeout + START
        ready = False
        while (rest := deadline - time.monotonic()) > 0:
            for event in self._wait(rest):
                self._keep(event)
                ready |= isinstance(event, wire.Words) and event.kind == b"R"
                if isinstance(event, wire.Words) and event.kind == b"F":
                    raise DeviceError(
                        self.place,
                        f"no connection to {self._where}: {event.text}",
                        "Check that the other side runs and listens there, the network, and the certificates",
                    )
            if ready:
                return
        self._open = False
        self._helper.end_hanging()

    def fileno(self) -> int | None:
        """Returns the socket's descriptor; only a whole message, of `stop_frames`, may be written to it."""
        return self._helper.fileno() if self._open else None

    @property
    def stop_frames(self) -> tuple[bytes, ...]:
        """The message that stops every outlet; another process may write it, too."""
        return self._stop_frames

    @property
    def untaken(self) -> bool:
        """Whether the process hasn't taken the newest command yet."""
        return self._sent != self._taken

    def read(self) -> list[wire.Event]:
        """Returns the events that have arrived, oldest first, limited in number; never blocks.

        Raises:
            DeviceLostError: the process has ended, or the connection is gone.
        """
        kept: list[wire.Event] = list(self._kept.values())
        self._kept.clear()
        return kept + self._receive()

    def _receive(self) -> list[wire.Event]:
        events: list[wire.Event] = []
        if not self._open:
            raise DeviceLostError(self.place, "it isn't open", "Open it first")
        for _ in range(MOST):
            try:
                message = self._helper.take()
            except ProcessEndedError:
                self._ended()
            if message is None:
                break
            if wire.head(message)[1] != self._session:
                continue
            event = wire.read_event(message)
            if isinstance(event, wire.Taken):
                self._taken = event.number
            elif isinstance(event, wire.Words) and event.kind == b"X":
                self._lost(event.text)
            else:
                events.append(event)
        return events

    def wait(self, timeout: float) -> list[wire.Event]:
        """Like `read`, but waits up to `timeout` s for the first event. Blocks: for `open` only."""
        return self.read() if self._kept else self._wait(timeout)

    def _wait(self, timeout: float) -> list[wire.Event]:
        self._helper.wait(timeout)
        return self._receive()

    def ask(self, key: str, timeout: float = 1.0) -> dict[str, bytes]:
        """Returns the answers to a query, by key. Blocks: for `open` only. The next `read` returns other events."""
        return self._answers(b"Q", key, timeout)

    def tokens(self, key: str, timeout: float = 1.0) -> list[str]:
        """Returns the liveliness tokens that exist now. Blocks: for `open` only."""
        return sorted(self._answers(b"T", key, timeout))

    def _answers(self, kind: bytes, key: str, timeout: float) -> dict[str, bytes]:
        self._tell(wire.simple(kind, self._session, {"key": key, "timeout": timeout}))
        deadline = time.monotonic() + timeout + 1.0
        found: dict[str, bytes] = {}
        over = False
        while (rest := deadline - time.monotonic()) > 0:
            for event in self._wait(rest):
                if isinstance(event, wire.Answer):
                    found[event.key] = event.payload
                elif isinstance(event, wire.Words):
                    over |= event.kind == b"E"
                self._keep(event)
            if over:
                break
        return found

    def _keep(self, event: wire.Event) -> None:
        if isinstance(event, wire.Sample | wire.Token):
            self._kept[isinstance(event, wire.Sample), event.source] = event

    def publish(self, outlet: int, payload: bytes, expires: int, stamp: int = -1) -> bool:
        """Passes a command on; never blocks. Returns False if the last one wasn't taken yet, or there is no room.

        Args:
            outlet: index.
            payload: its bytes.
            expires: ns, CLOCK_MONOTONIC, after which the command is void and the stop is published instead.
            stamp: ns of the peer's clock now; -1: unknown.
        Raises:
            DeviceLostError: the process has ended.
        """
        if self._sent != self._taken:
            return False
        number = self._sent % 0xFFFFFFFF + 1
        item = wire.Command(outlet, number, time.monotonic_ns(), expires, stamp, payload)
        if not self._give(wire.command(self._session, item)):
            return False
        self._sent = number
        return True

    def stop(self) -> None:
        """Stops every outlet; never blocks, never raises."""
        if self._open:
            with contextlib.suppress(DeviceLostError):
                self._give(self._stop_frames[0])

    def close(self) -> None:
        """Ends the session; publishes the stop first if a command was in force. Always succeeds."""
        if self._open:
            with contextlib.suppress(ProcessEndedError):
                self._helper.give(wire.simple(b"C", self._session))
        self._open = False

    def pid(self) -> int | None:
        """Returns the process id, for tests."""
        return self._helper.pid()

    def _tell(self, message: bytes) -> None:
        try:
            self._helper.tell(message)
        except ProcessEndedError:
            self._ended()
        except DeviceError:  # it hung, and was ended
            self._open = False
            raise

    def _give(self, message: bytes) -> bool:
        try:
            return self._helper.give(message)
        except ProcessEndedError:
            self._ended()

    def _ended(self) -> NoReturn:
        self._open = False
        self._lost("its zenoh process has ended")

    def _lost(self, why: str) -> NoReturn:
        raise DeviceLostError(self.place, f"{self._where}: {why}", "Check that the other side runs, and the network")

    def __del__(self) -> None:
        try:
            self._helper.let_go()
        except Exception:  # at the interpreter's end modules may be gone, contextlib among them
            pass


def _check(config: PeerConfig, place: str) -> None:
    """Checks what zenoh would report as a time-out only.

    Raises:
        DeviceError: no such host, or a certificate that can't be read.
    """
    if (host := config.host) is not None:
        try:
            socket.getaddrinfo(host, None)
        except OSError:
            raise DeviceError(place, f"no host is called '{host}'", "Correct `port`, or use its address") from None
    for name, path in (config.tls.model_dump() if config.tls is not None else {}).items():
        try:
            with open(path, "rb"):
                pass
        except OSError as error:
            raise DeviceError(
                place, f"tls.{name}: '{path}' can't be read ({error.strerror})", "Correct the path, or its permissions"
            ) from None
