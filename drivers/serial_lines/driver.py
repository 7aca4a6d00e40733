"""A sensor that sends numbers over a serial line, as a device."""

from __future__ import annotations

from math import isfinite
from typing import Final

from srl.drivers.linked import Linked
from srl.drivers.numbers.sampled import Sampled
from srl.drivers.numbers.signals import Numbers
from srl.drivers.serial_lines.config import SerialLinesConfig
from srl.drivers.serial_lines.protocol import Parser
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.driver import Sensor

_MOST: Final = 8192  # bytes that are looked at in one cycle: the newest
_LOOK: Final = "Look at the port, 'baudrate', 'format', and what the board sends (srl find-port)"


class SerialLines(Linked[Transport], Sensor):
    """Numbers in lines of text or in binary frames, as an Arduino sketch sends them. Nothing is written to it.

    States: those of `signals`, each (n,). Of several samples in one cycle the newest is taken.
    """

    Config = SerialLinesConfig
    summary = "any sensor that sends numbers over a serial line (an Arduino sketch, a load cell's board)"
    gives = ("<signal>",)
    max_age = 0.2
    config: SerialLinesConfig

    def __init__(self, name: str, config: SerialLinesConfig) -> None:
        super().__init__(name, config)
        self.config, self.states = config, config.states()
        self._numbers = Numbers(config)
        self._at = [column - 1 for column in self._numbers.places]
        self._begin()

    def _begin(self) -> None:
        self._parser = Parser(self.config)
        lossless = self.config.port.startswith("tcp") or self.config.counter is not None
        self._sampled = Sampled(self.config, self._place, self.health, self._numbers, lossless)
        self._counter: int | None = None
        self._gaps = 0

    def connect(self) -> Transport:
        return open_transport(self.config.port, place=self._place, baudrate=self.config.baudrate)

    def _set_up(self, link: Transport) -> None:
        """Waits for the first sample, up to `start`."""
        self._begin()
        self.health.stamp = -1
        came = 0
        for left in remaining(self.config.start):
            data = link.read_wait(left)
            came += len(data)
            if self._parser.feed(data):
                self._parser = Parser(self.config)  # what comes next may begin in the middle
                return
        if not came:
            raise self._error(f"nothing came within {self.config.start:g} s", f"Check its supply and cable. {_LOOK}")
        why = self._parser.why or (f"no line begins with '{self.config.prefix}'" if self._parser.others else "")
        raise self._error(f"{came} bytes came, and no sample{f': {why}' if why else ''}", _LOOK)

    def _receive(self, link: Transport, now: int) -> None:
        parser, before = self._parser, self._parser.errors
        data = link.read()[-_MOST:]
        for sample in parser.feed(data) if data else ():
            missed = self._missed(sample)
            if missed < 0:
                self._sampled.bad("its counter stands still or goes back")
                continue
            self._gaps += missed
            self._sampled.take([sample[at] for at in self._at], self.state_arrays, now, missed)
        for _ in range(parser.errors - before):
            self._sampled.bad(parser.why)
        self._sampled.listen(now)

    def _missed(self, sample: list[float]) -> int:
        """How many samples before this one are missing; -1: it is an old one."""
        if self.config.counter is None:
            return 0
        number, modulus = sample[self.config.counter - 1], self.config.counter_modulus
        if not (isfinite(number) and number == int(number) and 0 <= number < modulus):
            return -1
        before, self._counter = self._counter, int(number)
        if before is None:
            return 0
        step = (self._counter - before) % modulus
        if self._counter == 0 and step > modulus // 2:
            return 0  # it has restarted
        return step - 1 if 0 < step <= modulus // 2 else -1

    def metrics(self) -> dict[str, object]:
        """Returns the samples that its counter says are missing, and lines without the prefix."""
        return {"gaps": self._gaps, "other_lines": self._parser.others}
