"""The process that holds zenoh for one driver: `python -m srl.drivers.zenoh_link DESCRIPTOR`.

One thread listens to the driver; zenoh's own threads pass samples on. A sample that can't be passed on at once is
dropped: nothing waits here, and nothing old is kept.

Commands carry an expiry. If the driver sends no more, its last command expires, and the process publishes the stop
instead, for one second. After that it publishes nothing, so that the peer's own time-out decides. The same happens
when the driver's end of the socket closes.

To leave a session the process executes this program anew: a zenoh session with a dead peer may take long to close,
and an old connection must not deliver messages that it still holds.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

from srl.drivers.zenoh_link import wire
from srl.drivers.zenoh_link.config import session_config
from srl.runtime.messages import attachment

STOPS = 20  # number of times the stop is published
STOP_PERIOD = 50_000_000  # ns between them
WATCH = 100_000_000  # ns between checks of the connection
AGAIN = 5_000_000  # ns until a message is sent again that the driver's socket had no room for
IDLE = 30.0  # s without a session after which the process ends
CLOSING = 0.3  # s for an orderly close


class Outlet:
    """A publisher, its newest command's expiry, and the stop that follows."""

    def __init__(self, session: zenoh.Session, options: dict[str, Any]) -> None:
        self._publisher = session.declare_publisher(
            options["key"],
            encoding=options["encoding"] or None,
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )
        self._stop = bytes.fromhex(options["stop"])
        self._stamp_at: int | None = options["stamp_at"]
        self._attach: bool = options["attach"]
        self._sender = os.urandom(16)
        self._count = 0
        self._made = self._stamp = -1
        self.expires = 0  # 0: no command is in force
        self.left = 0  # stops still to publish
        self.due = 0

    def take(self, item: wire.Command, now: int) -> None:
        """Publishes a command, unless it is too old."""
        if now >= item.expires:
            return
        self._made, self._stamp = item.made, item.stamp
        self.expires, self.left = item.expires, STOPS
        self._put(item.payload, now)

    def halt(self, now: int) -> None:
        """Ends the command in force and publishes the stop at once."""
        if self.left:
            self.expires, self.due = 0, now
            self.turn(now)

    def turn(self, now: int) -> None:
        """Publishes the stop if it is due."""
        if self.expires and now >= self.expires:
            self.expires, self.due = 0, now
        if not self.expires and self.left and now >= self.due:
            self.left -= 1
            self.due = now + STOP_PERIOD
            self._put(self._stop, now)

    def next(self) -> int:
        """Returns the time (ns) of the next action of `turn`; far in the future if there is none."""
        return self.expires or (self.due if self.left else 1 << 62)

    def _put(self, payload: bytes, now: int) -> None:
        wall = time.time_ns()
        if self._stamp_at is not None:
            # The stamp is in the peer's clock if the driver knows it, because the peer may refuse stamps that look old.
            stamp = self._stamp + now - self._made if self._stamp >= 0 else wall
            at = self._stamp_at
            time_of = (stamp // 10**9).to_bytes(4, "little") + (stamp % 10**9).to_bytes(4, "little")
            payload = payload[:at] + time_of + payload[at + 8 :]
        self._count += 1
        extra = attachment.encode(self._count, wall, self._sender) if self._attach else None
        self._publisher.put(payload, attachment=extra)


class Process:
    """The process's main object; see the module's docstring."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._session: zenoh.Session | None = None
        self._number = 0
        self._outlets: list[Outlet] = []
        self._declared: list[Any] = []
        self._watched = 0
        self._untold = -1  # number of a taken command that isn't acknowledged yet
        self._ending = False

    def run(self) -> None:
        """Runs until the driver's end is closed, or SIGTERM."""
        signal.signal(signal.SIGTERM, self._terminate)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        poll = select.poll()
        poll.register(self._end, select.POLLIN)
        idle_since = time.monotonic()
        while not self._ending:
            now = time.monotonic_ns()
            due = min([o.next() for o in self._outlets], default=1 << 62)
            wait = min(max(due - now, 0), WATCH if self._untold < 0 else AGAIN)
            if poll.poll(wait / 1e6) and not self._hear():
                break
            now = time.monotonic_ns()
            for outlet in self._outlets:
                outlet.turn(now)
            self._acknowledge()
            if self._session is None:
                if time.monotonic() - idle_since > IDLE:
                    return
            elif now - self._watched > WATCH:
                self._watched = now
                self._watch()
        self._cease()

    def _terminate(self, *_: object) -> None:
        self._ending = True

    def _hear(self) -> bool:
        """Takes all waiting messages; the newest command of each outlet counts. Returns False if the end is closed."""
        newest: dict[int, wire.Command] = {}
        number = -1
        while True:
            try:
                message = self._end.recv(1 << 20, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            except OSError:
                return False
            if not message:
                return False
            kind, session = wire.head(message)
            if kind == b"O":
                self._open(session, wire.body(message))
            elif session != self._number or self._session is None:
                continue
            elif kind == b"P":
                command = wire.read_command(message)
                newest[command.outlet] = command
                number = command.number
            elif kind == b"S":
                newest.clear()
                for outlet in self._outlets:
                    outlet.halt(time.monotonic_ns())
            elif kind == b"C":
                self._leave()
            elif kind == b"Q":
                self._ask(wire.body(message), self._session.get)
            elif kind == b"T":
                self._ask(wire.body(message), self._session.liveliness().get)
        now = time.monotonic_ns()
        for outlet_number, command in newest.items():
            self._outlets[outlet_number].take(command, now)
        if number >= 0:
            self._untold = number
            self._acknowledge()
        return True

    def _acknowledge(self) -> None:
        """Reports the taken command until this succeeds: the driver sends no other command before."""
        if self._untold >= 0 and self._say(wire.taken(self._number, self._untold)):
            self._untold = -1

    def _open(self, number: int, order: dict[str, Any]) -> None:
        if self._session is not None:
            self._leave(again=wire.simple(b"O", number, order))
        self._number = number
        try:
            content = session_config(order["endpoint"], order["tls"], order["timeout"])
            self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(content)))
            self._outlets = [Outlet(self._session, options) for options in order["publish"]]
            for i, key in enumerate(order["subscribe"]):
                self._declared.append(self._session.declare_subscriber(key, self._passer(i)))
            for i, key in enumerate(order["alive"]):
                liveliness = self._session.liveliness()
                self._declared.append(liveliness.declare_subscriber(key, self._teller(i), history=True))
        except zenoh.ZError as error:
            self._say(wire.simple(b"F", number, str(error).partition(" at /")[0].rstrip(".! ")))
            self._leave()
        self._say(wire.simple(b"R", number))

    def _passer(self, source: int) -> Callable[[zenoh.Sample], None]:
        number = self._number

        def arrive(sample: zenoh.Sample) -> None:
            arrived = time.monotonic_ns()
            payload = sample.payload.to_bytes()
            if sample.kind != zenoh.SampleKind.PUT or len(payload) > wire.LARGEST:
                return
            extra = sample.attachment
            stamp = -1 if extra is None else attachment.stamp_of(extra.to_bytes())
            self._say(wire.sample(number, wire.Sample(source, arrived, stamp, str(sample.encoding), payload)))

        return arrive

    def _teller(self, source: int) -> Callable[[zenoh.Sample], None]:
        number = self._number

        def arrive(sample: zenoh.Sample) -> None:
            self._say(wire.token(number, source, sample.kind == zenoh.SampleKind.PUT))

        return arrive

    def _ask(self, order: dict[str, Any], get: Callable[..., Any]) -> None:
        """Queries in a thread, so that commands continue meanwhile."""
        number = self._number

        def work() -> None:
            try:
                for answer in get(order["key"], timeout=order["timeout"]):
                    if answer.ok is not None:
                        content = answer.ok.payload.to_bytes()[: wire.LARGEST]
                        self._say(wire.answer(number, str(answer.ok.key_expr), content))
            except zenoh.ZError:
                pass  # the driver then finds no answer
            self._say(wire.simple(b"E", number))

        threading.Thread(target=work, daemon=True).start()

    def _watch(self) -> None:
        assert self._session is not None
        info = self._session.info
        if not info.routers_zid() and not info.peers_zid():
            self._say(wire.simple(b"X", self._number, "the connection is closed"))

    def _say(self, message: bytes) -> bool:
        try:
            self._end.send(message, socket.MSG_DONTWAIT)
        except OSError:
            return False  # the driver doesn't read, or is gone; the next sample will be newer
        return True

    def _cease(self) -> None:
        """Ends the process when nobody sends commands any more: publishes the stop, then shuts down."""
        now = time.monotonic_ns()
        for outlet in self._outlets:
            outlet.halt(now)
        while any(outlet.left for outlet in self._outlets):
            time.sleep(STOP_PERIOD / 1e9)
            for outlet in self._outlets:
                outlet.turn(time.monotonic_ns())
        self._shut()

    def _shut(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            closing = threading.Thread(target=session.close, daemon=True)
            closing.start()
            closing.join(CLOSING)

    def _leave(self, again: bytes = b"") -> None:
        """Ends the session, with the stop if a command was in force; executes the program anew, with `again` first."""
        now = time.monotonic_ns()
        for outlet in self._outlets:
            outlet.halt(now)
        self._shut()
        words = [sys.executable, "-m", "srl.drivers.zenoh_link", str(self._end.fileno())]
        os.set_inheritable(self._end.fileno(), True)
        os.execv(words[0], [*words, again.hex()] if again else words)

    def begin(self, message: bytes) -> None:
        """Opens the session for which the program was executed anew."""
        self._open(wire.head(message)[1], wire.body(message))


def main(arguments: list[str]) -> int:
    """Runs the process. Returns the exit code."""
    if not 1 <= len(arguments) <= 2 or not arguments[0].isdigit():
        print("usage: python -m srl.drivers.zenoh_link DESCRIPTOR", file=sys.stderr)
        return 2
    end = socket.socket(fileno=int(arguments[0]))
    os.set_inheritable(end.fileno(), False)
    process = Process(end)
    if len(arguments) == 2:
        process.begin(bytes.fromhex(arguments[1]))
    process.run()
    sys.stdout.flush()
    os._exit(0)  # otherwise a zenoh session that couldn't close in time would keep the process alive
