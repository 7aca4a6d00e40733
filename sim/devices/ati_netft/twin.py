"""The twin of an ATI Net F/T: RDT over UDP, its web page and its TCP commands."""

from __future__ import annotations

from srl.drivers.ati_netft.protocol import Record, Request, parse_request, record
from srl.drivers.ati_netft.status import LATCHED, SATURATED, family
from srl.runtime.contracts.signals import Array
from srl.sim.devices.ati_netft.fake import COUNTS, FakeAtiNetFt
from srl.sim.devices.ati_netft.twin_pages import Commands, Pages
from srl.sim.devices.shared.sockets import Client, SocketTwin, TcpDoor, UdpDoor

_CATCH_UP = 0.5  # s; most records sent at once. Older samples were never taken in time.
_SUMMARY = 1 << 31
_LINGER = 32  # samples for which an Axia's saturation bits stay set (1.5)


class AtiNetFtTwin(SocketTwin):
    """Sends the record of sample k when the fake's sample k would arrive; a dropped sample leaves a gap.

    Only one client is served: the one that sent the last request. Any request ends the stream before it.

    Attributes:
        trouble: additional status bits to report, for tests.
        threshold: N; a larger force sets the latch. None: never.
    """

    def __init__(self, fake: FakeAtiNetFt) -> None:
        super().__init__(fake)
        options = fake.options
        self.sensor = fake
        self.trouble = 0
        self.threshold: float | None = None
        self.product = options.product
        self.counts = COUNTS
        self.buffered = 40
        self.sample_rate = self.record_rate = options.rate
        self.transform: tuple[float, ...] = (0.0,) * 6  # on its page alone
        self.range: Array = fake.range
        host = options.host
        self.records, self.http, self.tcp = UdpDoor(host), TcpDoor(host), TcpDoor(host)
        self._ports = (options.port, options.http, options.tcp)
        self._family = family(options.product)
        self._talks: dict[Client, Pages | Commands] = {}
        self._seen: dict[str, int] = {}
        self._unknown = 0
        self._start()

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self.records, self.http, self.tcp]

    def open(self) -> None:
        for door, port in zip(self.doors(), self._ports, strict=True):
            if not door.port:
                door.open(port)
        super().open()

    def describe(self) -> str:
        return f"{self.records.address}?http={self.http.port}&tcp={self.tcp.port}"

    def opened(self) -> None:
        self._start()

    def work(self, now: int) -> None:
        for data, peer in self.records.read():
            self._obey(data, peer)
        self._serve()
        self._stream()

    def power_cycle(self) -> None:
        """Switches the sensor off and on: the stream, the bias, the latch and the sample counter are reset."""
        self._start()
        self.sensor.unbias()
        self._first = max(self.sensor.newest(), 0)

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: requests by name, unknown datagrams, records sent."""
        return super().metrics() | {"requests": dict(self._seen), "unknown": self._unknown, "records": self._count}

    # -- what the pages use

    def status(self) -> int:
        """The present status word."""
        bits = self.trouble | LATCHED * self._latched
        if 0 <= self.sensor.newest() - self._saturated <= (_LINGER if self._family == "axia" else 0):
            bits |= SATURATED[self._family]
        return bits | _SUMMARY * bool(bits)

    def counts_now(self) -> list[int]:
        """The newest sample, in counts."""
        newest = self.sensor.newest()
        values = self.sensor.measured(newest) if newest >= 0 else None
        return [0] * 6 if values is None else _counts(values)

    def bias(self) -> None:
        """Takes the present load as zero."""
        self.sensor.bias()

    def reset_latch(self) -> None:
        """Ends the monitor condition."""
        self._latched = False

    # -- RDT

    def _start(self) -> None:
        self._client: tuple[str, int] | None = None
        self._left: int | None = 0  # records still to be sent; None: without end
        self._sequence = 0
        self._batch: list[bytes] | None = None  # records collected in buffered mode
        self._sent = self.sensor.newest()  # number of the newest sample handled
        self._first = 0  # sample at which the counter began
        self._saturated = -(1 << 40)  # number of the newest saturated sample
        self._latched = False
        self._count = 0

    def _obey(self, data: bytes, peer: tuple[str, int]) -> None:
        parsed = parse_request(data)
        if parsed is None or parsed[0] not in Request.__members__.values():
            self._unknown += 1
            return
        command, count = Request(parsed[0]), parsed[1]
        self._seen[command.name] = self._seen.get(command.name, 0) + 1
        self._left, self._batch = 0, None
        if command in (Request.START, Request.START_BUFFERED):
            self._client, self._left, self._sequence = peer, count or None, 0
            self._sent = self.sensor.newest()
            if command is Request.START_BUFFERED:
                self._batch = []
            if count == 1:  # polled mode: answers at once
                self._send(self.sensor.newest())
        elif command is Request.BIAS:
            self.bias()
        elif command is Request.RESET_LATCH:
            self.reset_latch()

    def _stream(self) -> None:
        newest = self.sensor.newest()
        begin = max(self._sent + 1, newest - int(_CATCH_UP * self.sample_rate))
        self._sent = max(self._sent, newest)
        for number in range(begin, newest + 1):
            self._watch(number)
            due = int(number * self.record_rate / self.sample_rate)
            if due != int((number - 1) * self.record_rate / self.sample_rate):
                self._send(number)

    def _watch(self, number: int) -> None:
        if any(self.sensor.overload(number)):
            self._saturated = number
        if self.threshold is not None:
            values = self.sensor.measured(number)
            self._latched |= values is not None and bool(abs(values[:3]).max() > self.threshold)

    def _send(self, number: int) -> None:
        if self._left == 0 or self._client is None or number < 0:
            return
        if self._left is not None:
            self._left -= 1
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        values = self.sensor.measured(number)
        if values is None:
            return
        sample = (number - self._first) & 0xFFFFFFFF
        data = record(Record(self._sequence, sample, self.status(), tuple(_counts(values))))  # type: ignore[arg-type]
        self._count += 1
        if self._batch is None:
            self.records.write(data, self._client)
            return
        self._batch.append(data)
        if len(self._batch) >= self.buffered or self._left == 0:
            self.records.write(b"".join(self._batch), self._client)
            self._batch = []

    # -- pages and commands

    def _serve(self) -> None:
        for door, kind in ((self.http, Pages), (self.tcp, Commands)):
            for client in door.accept():
                self._talks[client] = kind(self)
        for client, talk in list(self._talks.items()):
            data = client.read()
            answer = talk.feed(data) if data else None
            if answer:
                client.write(answer, keep=True)
            if isinstance(talk, Pages) and answer is not None:
                client.close()
            if client.gone:
                del self._talks[client]


def _counts(values: Array) -> list[int]:
    return [max(-(1 << 31), min((1 << 31) - 1, round(value * COUNTS))) for value in values.tolist()]
