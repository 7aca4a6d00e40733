"""What opening an MTi asks, reads back and refuses. Blocks; nothing here is called in a cycle."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport
from srl.drivers.xsens_mti import data
from srl.drivers.xsens_mti.config import XsensMtiConfig
from srl.drivers.xsens_mti.protocol import ERRORS, EVERY, Id, Message, Parser, configuration, configure, encode
from srl.runtime.contracts.errors import DeviceError

ASK: Final = 0.1  # s between two equal questions
TIMEOUT: Final = 1.5  # s for an answer: after power-on it takes its time
FIRST: Final = 1.0  # s for the first message with an orientation
_WIRING: Final = "Check TX, RX and ground, its supply, and that the port is its own"


class Session:
    """Questions and answers at an open port."""

    def __init__(self, link: Transport, place: str) -> None:
        self._link, self._place, self.parser = link, place, Parser()
        self._heard = 0

    def ask(self, question: bytes, answer: Id, fits: Callable[[bytes], bool] = lambda _: True) -> bytes:
        """The data of the answer; the question is repeated until one comes that fits.

        An answer may be that to an earlier, equal question: one that doesn't fit is returned only if no other comes.

        Raises:
            DeviceError: none comes, or an error.
        """
        until, again = time.monotonic() + TIMEOUT, 0.0
        other: bytes | None = None
        while (now := time.monotonic()) < until:
            if now >= again:
                self._link.write_all(question, ASK)
                again = now + ASK
            heard = self._link.read_wait(max(min(again, until) - now, 0.0))
            self._heard += len(heard)
            for message in self.parser.feed(heard):
                if message.id == answer and fits(message.data):
                    return message.data
                if message.id == answer:
                    other = message.data
                if message.id == Id.ERROR:
                    raise self._refused(message)
        if other is not None:
            return other
        raise self._nothing()

    def await_orientation(self) -> None:
        """Waits for a message with an orientation, valid or not. Raises DeviceError: none comes."""
        for left in remaining(FIRST):
            for message in self.parser.feed(self._link.read_wait(left)):
                sample = data.decode(message.data) if message.id == Id.DATA else None
                if sample is not None and sample.orientation is not None:
                    return
        problem = f"it measures, but no orientation came in {FIRST:g} s"
        raise DeviceError(
            self._place, problem, "An MTi-1 has none: take a model with an orientation filter (2, 3, 20..)"
        )

    def _refused(self, message: Message) -> DeviceError:
        code = message.data[0] if message.data else 0
        return DeviceError(self._place, f"it says: {ERRORS.get(code, f'error {code}')}", "Ask for a lower 'rate'")

    def _nothing(self) -> DeviceError:
        if not self._heard:
            return DeviceError(self._place, f"expected an MTi, got nothing in {TIMEOUT:g} s", _WIRING)
        if not self.parser.frames:
            return DeviceError(
                self._place,
                f"expected an MTi, got {self._heard} bytes that are no message of one",
                "Set 'baudrate' to what it is set to, or choose its own port: another device may be there",
            )
        return DeviceError(self._place, "it sends, but doesn't answer", "Connect its RX, to which this port sends")


def identify(session: Session) -> str:
    """Stops the sensor's measuring; returns its id in hex."""
    session.ask(encode(Message(Id.GO_TO_CONFIG, b"")), Id.CONFIGURING)
    return session.ask(encode(Message(Id.REQ_DEVICE, b"")), Id.DEVICE).hex().upper()


def begin(session: Session, config: XsensMtiConfig, place: str) -> str:
    """Brings the sensor to send what the profile wants; returns its id.

    Raises:
        DeviceError: it is another one, or it doesn't send that; with the remedy.
    """
    found = identify(session)
    if config.device is not None and found != config.device.upper():
        raise DeviceError(place, f"it is {found}, not {config.device.upper()}", "Exchange the cables, or set 'device'")
    wanted = config.items()
    has = configuration(session.ask(encode(Message(Id.CONFIGURATION, b"")), Id.CONFIGURED))
    if has != wanted:
        if not config.configure:
            problem = f"it sends {_text(has)}, not {_text(wanted)}"
            raise DeviceError(place, problem, "Set it up with the maker's program, or let 'configure: true' do it")
        has = configuration(session.ask(configure(wanted), Id.CONFIGURED, lambda data: configuration(data) == wanted))
        if has != wanted:
            raise DeviceError(place, f"asked for {_text(wanted)}, it took {_text(has)}", "Ask for another 'rate'")
    session.ask(encode(Message(Id.GO_TO_MEASUREMENT, b"")), Id.MEASURING)
    session.await_orientation()
    return found


def _text(items: dict[int, int] | None) -> str:
    """A configuration in words."""
    if not items:
        return "nothing"
    return ", ".join(f"{item:04X}" + ("" if rate == EVERY else f" at {rate} Hz") for item, rate in items.items())
