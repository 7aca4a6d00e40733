"""The twin of a Robotous RFT: its frames on a CAN bus of python-can."""

from __future__ import annotations

from collections.abc import Callable

import can

from srl.drivers.can_ft.protocol import AXES, CUTOFFS, FRAME, RATES, Command, Record, record, response
from srl.sim.devices.can_ft.fake import FakeCanFt
from srl.sim.devices.shared.can import CanTwin

_CATCH_UP = 0.5  # s; most records sent at once
_FIRMWARE = "SIM 1.0"
_OK, _FAILED = b"\1\0", b"\0\2"  # result; result and "out of range"


class CanFtTwin(CanTwin):
    """Answers the sheet's commands and streams the fake's samples when they would arrive.

    A loss of power clears the stream, the rate, the filter, the bias. While it streams, it obeys only STOP, READ_RATE
    and BIAS.
    """

    def __init__(self, fake: FakeCanFt) -> None:
        super().__init__(fake)
        config = fake.config
        self.sensor = fake
        self._ids = config.ids
        self._default_rate = RATES[0]
        self._seen: dict[str, int] = {}
        self._unknown = self._sent_records = 0
        self._counters = [0] * 6
        self._streaming = False
        self._sent = -1
        self._was_overloaded = 0
        self._rate_code, self._filter = 0, (0, 0)
        self._answers: dict[int, Callable[[bytes], bytes]] = {
            Command.MODEL: lambda _: fake.model.encode("ascii"),
            Command.SERIAL: lambda _: fake.serial.encode("ascii", "replace"),
            Command.FIRMWARE: lambda _: _FIRMWARE.encode("ascii"),
            Command.SET_IDS: self._set_ids,
            Command.READ_IDS: lambda _: bytes((*self._ids, *self._pending)),
            Command.SET_FILTER: self._set_filter,
            Command.READ_FILTER: lambda _: bytes(self._filter),
            Command.SET_RATE: self._set_rate,
            Command.READ_RATE: lambda _: bytes((self._rate_code,)),
            Command.OVERLOADS: lambda _: bytes(self._counters),
        }
        self._pending = self._ids

    # -- life cycle

    def power_up(self) -> None:
        """Changed ids take effect, everything else is reset."""
        self._ids = self._pending
        self._streaming = False
        self._rate_code, self._filter = 0, (0, 0)
        self._counters = [0] * 6
        self.sensor.unbias()
        self.sensor.cutoff = 0
        self.sensor.set_rate(self._default_rate)
        self._sent = self.sensor.newest()

    def take(self, message: can.Message, now: int) -> None:
        data = bytes(message.data)
        if message.arbitration_id == self._ids[0] and len(data) == FRAME and not message.is_extended_id:
            self._obey(data)

    def idle(self) -> None:
        """What it doesn't send is lost."""
        self._sent = self.sensor.newest()

    def metrics(self) -> dict[str, object]:
        """Adds commands by name, unknown frames, records sent."""
        found = {"commands": dict(self._seen), "unknown": self._unknown, "records": self._sent_records}
        return found | super().metrics()

    # -- the sensor

    def _obey(self, data: bytes) -> None:
        code = data[0]
        if code not in Command.__members__.values():
            self._unknown += 1
            if not self._streaming:
                self._send(response(code, b"\0\1"))
            return
        name = Command(code).name
        self._seen[name] = self._seen.get(name, 0) + 1
        if code == Command.STOP:
            self._streaming = False
        elif code == Command.BIAS:
            if data[1]:
                self.sensor.bias()
            else:
                self.sensor.unbias()
        elif self._streaming and code != Command.READ_RATE:
            return
        elif code == Command.START:
            self._streaming = True
            self._sent = self.sensor.newest()
        elif code == Command.READ_ONCE:
            self._send_record(self.sensor.newest(), polled=True)
        else:
            self._send(response(code, self._answers[code](data[1:])))

    def work(self, now: int) -> None:
        """Streams."""
        newest = self.sensor.newest()
        begin = max(self._sent + 1, newest - int(_CATCH_UP * self.sensor.rate))
        self._sent = max(self._sent, newest)
        for number in range(begin, newest + 1):
            self._watch(number)
            if self._streaming:
                self._send_record(number, polled=False)

    def _watch(self, number: int) -> None:
        """Counts how often an overload begins."""
        bits = self._overload(number)
        for axis in range(len(AXES)):
            bit = 1 << 5 - axis
            if bits & bit and not self._was_overloaded & bit:
                self._counters[axis] = min(self._counters[axis] + 1, 255)
        self._was_overloaded = bits

    def _overload(self, number: int) -> int:
        return sum(beyond << 5 - axis for axis, beyond in enumerate(self.sensor.overload(number)))

    def _send_record(self, number: int, polled: bool) -> None:
        if number < 0:
            return
        values = self.sensor.measured(number)
        if values is not None:
            counts = tuple(int(count) for count in self.sensor.raw(values))
            self._send(record(Record(counts, self._overload(number), polled)))  # type: ignore[arg-type]
            self._sent_records += 1

    def _send(self, halves: tuple[bytes, bytes]) -> None:
        for can_id, data in zip(self._ids[1:], halves, strict=True):
            self.send(can_id, data)

    # -- settings

    def _set_ids(self, values: bytes) -> bytes:
        wanted = (values[0], values[1], values[2])
        if len(set(wanted)) != 3 or 0 in wanted:
            return _FAILED
        self._pending = wanted
        return _OK

    def _set_filter(self, values: bytes) -> bytes:
        kind, parameter = values[0], values[1]
        if kind > 1 or parameter >= len(CUTOFFS):
            return _FAILED
        self._filter = (kind, parameter)
        self.sensor.cutoff = CUTOFFS[parameter] if kind else 0
        return _OK

    def _set_rate(self, values: bytes) -> bytes:
        if values[0] >= len(RATES):
            return _FAILED
        self._rate_code = values[0]
        self.sensor.set_rate(RATES[values[0]])
        self._sent = self.sensor.newest()
        return _OK
