"""The twin of an MTi: answers on a serial port, and MTData2 messages while it measures."""

from __future__ import annotations

from typing import Final

from srl.drivers.xsens_mti import data
from srl.drivers.xsens_mti.protocol import EVERY, Id, Message, Parser, configuration, encode
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.xsens_mti.fake import FakeXsensMti

DEVICE: Final = bytes.fromhex("0080005A")  # of an invented sensor
FACTORY: Final = {data.COUNTER: EVERY, data.FINE: EVERY, 0x2030: 100}  # Euler angles: not what the driver wants
_KNOWN: Final = (data.COUNTER, data.FINE, data.QUATERNION, data.ACCELERATION, data.TURN, data.STATUS, 0x2030)
_FASTEST: Final = 400  # Hz
_PERIOD, _INVALID = 3, 4  # codes of errors
_CATCH_UP: Final = 20  # most messages sent at once; older ones were never taken in time
_MANY: Final = 32  # items of a configuration


class XsensMtiTwin(SerialTwin):
    """Begins to measure when it is switched on, with the output that it has kept.

    Attributes:
        output: what it sends: ids and rates.
        valid: whether its orientation filter says that it is.
        questions: ids that it was asked.
    """

    def __init__(self, fake: FakeXsensMti) -> None:
        super().__init__(fake)
        self.mti = fake
        self.output: dict[int, int] = dict(FACTORY)
        self.valid = True
        self.questions: list[int] = []
        self._parser = Parser()
        self._measuring, self._starting = True, False
        self._sent, self._first, self._counter = -1, 0, 0

    def open(self) -> None:
        super().open()
        self._sent = self.mti.newest()

    def restart(self) -> None:
        """The sensor is switched off and on: its counters begin anew."""
        self._first, self._counter = self.mti.newest() + 1, 0
        self._parser, self._measuring, self._starting = Parser(), True, True

    def receive(self, data: bytes, now: int) -> bytes:
        return b"".join(encode(self._answer(message)) for message in self._parser.feed(data))

    def _answer(self, message: Message) -> Message:
        self.questions.append(message.id)
        if message.id == Id.GO_TO_CONFIG:
            self._measuring = False
        elif message.id == Id.GO_TO_MEASUREMENT:
            self._measuring, self._sent = True, self.mti.newest()
        elif self._measuring or message.id not in (Id.REQ_DEVICE, Id.CONFIGURATION):
            return Message(Id.ERROR, bytes((_INVALID,)))
        elif message.id == Id.REQ_DEVICE:
            return Message(Id.DEVICE, DEVICE)
        else:
            return self._configure(message.data)
        return Message(message.id + 1, b"")

    def _configure(self, given: bytes) -> Message:
        if given:
            wanted = configuration(given)
            if wanted is None or len(wanted) > _MANY:
                return Message(Id.ERROR, bytes((_INVALID,)))
            if any(rate != EVERY and rate > _FASTEST for rate in wanted.values()):
                return Message(Id.ERROR, bytes((_PERIOD,)))
            self.output = {item: rate for item, rate in wanted.items() if item in _KNOWN}
        pairs = (item.to_bytes(2, "big") + rate.to_bytes(2, "big") for item, rate in self.output.items())
        return Message(Id.CONFIGURED, b"".join(pairs))

    def work(self, now: int) -> bytes:
        newest = self.mti.newest()
        sent = [encode(Message(Id.WAKEUP, b""))] if self._starting else []
        self._starting = False
        for number in range(max(self._sent + 1, newest - _CATCH_UP + 1), newest + 1):
            values = self.mti.sample(number)
            self._counter += 1
            if values is not None and self._measuring:
                sent.append(encode(Message(Id.DATA, data.encode(self._items(values.tolist(), number)))))
        self._sent = newest
        return b"".join(sent)

    def _items(self, values: list[float], number: int) -> dict[int, float | tuple[float, ...]]:
        tick = (self.mti.taken_at(number) - self.mti.taken_at(self._first)) // data.TICK
        items: dict[int, float | tuple[float, ...]] = {
            data.COUNTER: (self._counter - 1) % (1 << 16),
            data.FINE: tick % (1 << 32),
            data.QUATERNION: tuple(values[:4]),
            data.ACCELERATION: tuple(values[4:7]),
            data.TURN: tuple(values[7:]),
            data.STATUS: 1 | (data.FILTER_VALID if self.valid else 0),
        }
        return {item: items[item] for item in self.output if item in items}
