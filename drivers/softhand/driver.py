"""The SoftHand as a device: one closure command, answered by position and current.

Neither activation nor references are acknowledged. So one query follows each command in the same write, and the
next command waits for the query's answer. So a stalled link never holds more than one command, and nothing is sent
on the half-duplex line while the hand may be answering. A reference is repeated even if it doesn't change: this
replaces a reference that was lost on the line, and feeds the hand's watchdog.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from typing import Final

import numpy as np

from srl.drivers.linked import Linked
from srl.drivers.softhand import protocol
from srl.drivers.softhand.config import USUAL, SoftHandConfig
from srl.drivers.softhand.motor import Motor
from srl.drivers.softhand.opening import ANSWER, REMEDY, Opening, is_echo
from srl.drivers.softhand.protocol import Cmd, Frame, Parser
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Command, Kind, Limits, Signal, Stop

COMMAND: Final = "position_command"
PERIOD: Final = 0.05  # s: a command waits for the answer to the one before, over USB with a latency timer of 16 ms
RESOLUTION: Final = 1e-3  # a tick of a hand with a short range
REPEAT: Final = 40_000_000  # ns between equal references
ASK_IDLE: Final = 20_000_000  # ns between queries while there are no commands
ASK_AGAIN: Final = 50_000_000  # ns without an answer after which a query is sent again, without a command
CHECK: Final = 100_000_000  # ns between queries whether the motor is on
GONE: Final = 500_000_000  # ns without an answer after which the hand counts as lost
TIMEOUT: Final = 1_000_000_000  # ns that switching on the motor may take
_LONG_AGO: Final = -(1 << 62)
_OFF, _TURNING_ON, _ON, _TURNING_OFF = Motor  # looking a member up takes longer than comparing it
_GET_BOTH, _GET_ACTIVATE = Cmd.GET_BOTH, Cmd.GET_ACTIVATE


class SoftHand(Linked[Transport]):
    """A SoftHand: command `position_command` (1,), states `position` (1,) and `current` (1,), A.

    Command and position are the closure: 0 open, 1 closed. Closure is a share of the hand's own range, so a profile
    fits hands with different ranges. A sample's stamp is the time of its request, so a sample is never older than its
    stamp. Source: sheet qbhand.
    """

    Config = SoftHandConfig
    summary = "qb SoftHand / Pisa-IIT SoftHand: one motor, one synergy (RS485)"
    pictured_as = "softhand"
    usb = ("0403",)  # FTDI, in the vendor's adapter
    gives = ("position", "current")
    takes = (COMMAND,)
    max_age = 0.2

    def __init__(self, name: str, config: SoftHandConfig) -> None:
        super().__init__(name, config)
        self.config: SoftHandConfig = config
        self.states = (
            Signal(name="position", shape=(1,), unit="1", labels=("closure",)),
            Signal(name="current", shape=(1,), unit="A", labels=("motor",)),
        )
        self.commands = (
            Command(
                name=COMMAND,
                shape=(1,),
                unit="1",
                labels=("closure",),
                kind=Kind.POSITION,
                feedback="position",
                stops=(Stop.HOLD, Stop.LIMP),
                period=PERIOD,
                resolution=RESOLUTION,
            ),
        )
        self.limits[COMMAND] = Limits(lower=np.array([0.0]), upper=np.array([1.0]))
        self._place = f"{name} ({config.port}, id {config.id})"
        self._parser = Parser()
        self._range = USUAL
        self._range_source = ""  # where the range comes from
        self._serial = ""
        self._queries = {query: protocol.frame(config.id, query) for query in (_GET_BOTH, _GET_ACTIVATE)}
        self._queries[Cmd.SET_WATCHDOG] = protocol.set_watchdog(config.id, round(config.watchdog * 1000))
        self._armed = False  # whether the watchdog is armed
        self._on = protocol.activate(config.id, True)
        self._off = protocol.activate(config.id, False)
        self._limp_frames = (protocol.FLUSH + self._off + self._off,)
        self._hold_frames: tuple[bytes, ...] | None = None
        self._motor = _OFF
        self._sent: int | None = None  # reference, ticks
        self._waiting: Cmd | None = None  # the query whose answer hasn't come yet
        # ns: when the newest answer came; when the motor was last commanded to switch; -1: not yet
        self._heard = self._switched = -1
        # ns: the newest query; the newest repeated query; the newest call of `write`; the newest reference; the newest
        # query whether the motor is on; since when the motor is being switched on
        self._last_query = self._repeated = self._written = self._sent_at = self._checked = self._since = _LONG_AGO
        self._off_answers = 0  # consecutive answers that the motor is off, while it should be on
        self._surely_off = False  # the hand has confirmed that its motor is off, and got no other command since
        self._asks: deque[int] = deque()  # ns: position queries that may still be answered
        self._switched_off = 0

    # -- lifecycle

    def connect(self) -> Transport:
        return open_transport(self.config.port, place=self._place, baudrate=self.config.baudrate)

    def _set_up(self, link: Transport) -> None:
        """Blocks up to 4 s. Doesn't switch the motor on."""
        opening = Opening(link, self._parser, self.config, self._place)
        self._serial = opening.identify()
        self._range, self._range_source = opening.find_range()
        on, self._armed = opening.arm(self._queries[Cmd.SET_WATCHDOG])
        self._surely_off = not on
        self._forget()
        self._parser.reset()
        self._count()
        self.health.fault = ""
        self.health.message = self._range_source

    def _receive(self, link: Transport, now: int) -> None:
        """Also continues switching on or off."""
        if self._heard < 0:
            self._heard = now
        data = link.read()
        if data:
            for found in self._parser.feed(data):
                if found.id == self.config.id:
                    self._take(found, now)
            self._count()
        if now - self._heard > GONE:
            raise self._lost(f"no answer for {GONE / 1e9:g} s", REMEDY)
        self._keep_asking(link, now)

    def write(self, now: int) -> None:
        """The first call switches the motor on; references follow when the hand confirms this."""
        link = self._open_link()
        if self._heard < 0:
            self._heard = now
        self._written = now
        if self.health.fault:
            return
        if self._motor in (_OFF, _TURNING_OFF):
            self._motor, self._surely_off = _TURNING_ON, False
            self._since, self._switched = now, -1
        frame, query = b"", _GET_BOTH
        reference = self._reference()
        if self._motor is _TURNING_ON:
            if not self._armed:
                query = Cmd.SET_WATCHDOG
            elif self._switched < 0 or now - self._switched >= ASK_AGAIN:
                frame, query = self._on, _GET_ACTIVATE
        else:
            if now - self._checked >= CHECK:
                query = _GET_ACTIVATE
            if reference is not None and (reference != self._sent or now - self._sent_at >= REPEAT):
                frame = protocol.set_inputs(self.config.id, reference)
        if not self._ask(link, now, frame, query):
            self.health.unsent = len(frame)
        elif frame and self._motor is _TURNING_ON:
            self._switched = now
        elif frame:
            if reference != self._sent:
                self._hold_frames = None
            self._sent, self._sent_at = reference, now
            self.sent_arrays[COMMAND][0] = min(max(float(self.command_arrays[COMMAND][0]), 0.0), 1.0)

    def stop(self, category: Stop) -> None:
        """LIMP commands the motor off until the hand confirms it; HOLD keeps the reference."""
        link = self._link
        if link is None:
            return
        with contextlib.suppress(DeviceError):  # the next read reports a lost link
            if category is not Stop.LIMP:
                link.write(b"")
            elif self._motor is not _TURNING_OFF and not self._surely_off:
                self._motor = _TURNING_OFF
                self._switched = -1
                self._sent = None
                link.write(self._off)  # at once; if it collides with an answer, `read` sends it again

    def recover(self, now: int) -> None:
        """Clears the fault. The next start switches the motor on again, at the hand's position at that time."""
        self.health.fault = ""
        self.health.message = self._range_source
        self._motor = _OFF
        self._sent = self._hold_frames = None

    def _end(self, link: Transport) -> None:
        """Switches the motor off."""
        if self.health.connected:
            link.write_all(protocol.FLUSH + self._off, ANSWER)

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """The hand with id 1, as they are delivered."""
        config = SoftHandConfig(port=port)
        link = open_transport(port, place=port, baudrate=config.baudrate)
        try:
            serial = Opening(link, Parser(), config, port).identify()
        finally:
            link.close()
        return f"a SoftHand with id {config.id}" + (f", serial number {serial}" if serial else "")

    def fileno(self) -> int | None:
        return self._link.fileno() if self._link is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """HOLD disables the watchdog, which would release the hand, and repeats the goal."""
        if category is Stop.LIMP or self._sent is None:
            return self._limp_frames
        if self._hold_frames is None:
            watchdog, inputs = protocol.set_watchdog(self.config.id, 0), protocol.set_inputs(self.config.id, self._sent)
            self._hold_frames = (protocol.FLUSH + watchdog + inputs,)
        return self._hold_frames

    def metrics(self) -> dict[str, object]:
        """Returns range (ticks), last reference sent (ticks), serial number, times the motor switched itself off."""
        return {
            "range": list(self._range),
            "reference": self._sent,
            "serial": self._serial,
            "switched_off": self._switched_off,
        }

    # -- cycle

    def _take(self, found: Frame, now: int) -> None:
        if found.command == _GET_BOTH and len(found.data) == 10:
            milliamperes, _, ticks, *_ = protocol.int16s(found.data)
            low, high = self._range
            self.state_arrays["position"][0] = (ticks - low) / (high - low)
            self.state_arrays["current"][0] = milliamperes * 1e-3
            if self._asks:
                self.health.stamp = self._asks.popleft()
        elif found.command == _GET_ACTIVATE and len(found.data) == 1:
            self._confirm(found.data[0] != 0)
        elif found.command == Cmd.SET_WATCHDOG and not is_echo(found, self._queries[Cmd.SET_WATCHDOG]):
            self._armed = any(found.data)
        else:
            return
        self._heard = now
        if found.command == self._waiting:
            self._waiting = None
            self.health.unsent = 0

    def _confirm(self, on: bool) -> None:
        """Takes the hand's report whether its motor is on. An answer sent before a switch may show the old state."""
        motor = self._motor
        if motor is _TURNING_ON and on and self._switched >= 0:
            self._motor = _ON
            self._off_answers = 0
            self._sent = None
        elif motor is _TURNING_OFF and not on and self._switched >= 0:
            self._motor, self._surely_off = _OFF, True
        elif motor is _ON:
            self._off_answers = 0 if on else self._off_answers + 1
            if self._off_answers == 2:
                self._motor, self._surely_off = _OFF, True
                self._switched_off += 1
                self.health.fault = "the hand has switched its motor off (its watchdog, its supply, or by hand)"

    def _keep_asking(self, link: Transport, now: int) -> None:
        if self._motor is _TURNING_ON and now - self._since > TIMEOUT:
            self._motor = _OFF
            self.health.fault = "the hand doesn't switch its motor on"
        if self._waiting is not None:
            if now - self._last_query >= ASK_AGAIN and link.write(self._queries[self._waiting]):
                if self._waiting is _GET_BOTH:
                    if self._repeated != self._last_query:  # after this silence no earlier answer is on its way
                        self._asks = deque(list(self._asks)[-1:])
                    self._asks.append(now)
                self._last_query = self._repeated = now
        elif self._motor is _TURNING_OFF and now - self._switched >= ASK_AGAIN:
            if self._ask(link, now, self._off, _GET_ACTIVATE):
                self._switched = now
        elif now - self._written >= 10 * ASK_IDLE and now - self._last_query >= ASK_IDLE:
            self._ask(link, now, b"", _GET_BOTH)

    def _ask(self, link: Transport, now: int, command: bytes, query: Cmd) -> bool:
        """Sends a query, after a command if there is one, unless an answer is due or the link is busy."""
        if self._waiting is not None:
            return False
        try:
            if not link.write(command + self._queries[query]):
                return False
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        self._last_query = now
        self._waiting = query
        if now - self._repeated > 2 * ASK_AGAIN:
            self._asks.clear()  # a query sent twice can no longer be answered twice
        if query is _GET_BOTH:
            self._asks.append(now)
        if query is _GET_ACTIVATE:
            self._checked = now
        return True

    def _reference(self) -> int | None:
        """Returns the reference in ticks, within the range; the last one if the command isn't finite."""
        closure = float(self.command_arrays[COMMAND][0])
        if not math.isfinite(closure):
            return self._sent
        low, high = self._range
        return round(low + min(max(closure, 0.0), 1.0) * (high - low))

    def _forget(self) -> None:
        """Resets everything known about the hand before it was opened."""
        self._motor = _OFF
        self._sent = self._waiting = self._hold_frames = None
        self._heard, self._switched, self._off_answers = -1, -1, 0
        self._last_query = self._repeated = self._written = self._sent_at = self._checked = self._since = _LONG_AGO
        self._asks.clear()

    def _count(self) -> None:
        health, parser = self.health, self._parser
        health.frames, health.errors, health.resyncs = parser.frames, parser.errors, parser.resyncs
