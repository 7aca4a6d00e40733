"""A program, a phone or a glove's own streamer that sends numbers by UDP, as a device."""

from __future__ import annotations

from typing import Final

from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Linked
from srl.drivers.numbers.sampled import Sampled
from srl.drivers.numbers.signals import Numbers
from srl.drivers.timeout import remaining
from srl.drivers.udp_messages.config import UdpMessagesConfig
from srl.drivers.udp_messages.protocol import of_json, of_osc
from srl.runtime.contracts.driver import DeviceConfig, Sensor

_LOOK: Final = "Look at the sender's address and port, and at a firewall"
_BACK: Final = 1000  # samples by which a sequence may go back: more is a sender that began anew


class UdpMessages(Linked[Datagrams], Sensor):
    """JSON or OSC by UDP. The network isn't protected: anybody in it can pretend to be the sender.

    States: those of `signals`, each (n,). A JSON datagram is a sample if it has all numbers. Of OSC a sample is whole
    once each number has come since the last one. Datagrams of other hosts than `sender` (or the first that sent a
    sample) don't count.
    """

    Config: type[DeviceConfig] = UdpMessagesConfig
    summary = "anything that sends numbers by UDP: JSON or OSC (phones, gloves' own streamers, hand tracking)"
    gives: tuple[str, ...] = ("<signal>",)
    max_age = 0.2
    config: UdpMessagesConfig

    def __init__(self, name: str, config: UdpMessagesConfig) -> None:
        super().__init__(name, config)
        self.config, self.states = config, config.states()
        self._numbers = Numbers(config)
        self._wanted = config.places
        self._begin()

    def _begin(self) -> None:
        self._sampled = Sampled(self.config, self._place, self.health, self._numbers, lossless=False)
        self._peer = self.config.sender
        self._found: dict[str, float] = {}
        self._sequence: float | None = None
        self._clock = DeviceTime(1.0)
        self._gaps = self._strangers = 0

    def connect(self) -> Datagrams:
        return open_datagrams(self.config.port, place=self._place, listen=True)

    def _set_up(self, link: Datagrams) -> None:
        """Waits for the first sample, up to `start`."""
        self._begin()
        self.health.stamp = -1
        came, why = 0, ""
        for left in remaining(self.config.start):
            link.wait(left)
            for data, peer in link.read_from():
                came += 1
                try:
                    if self._sample(data, peer[0]) is not None:
                        self._found.clear()
                        self._sequence = None
                        return
                except ValueError as error:
                    why = str(error)
        if came:
            lacks = [place for place in self._wanted if place not in self._found]
            why = why or (f"it has no number at '{lacks[0]}'" if lacks else f"none is from {self.config.sender}")
            raise self._error(f"{came} datagrams came, and no sample: {why}", "Look at 'format' and 'signals'")
        raise self._error(f"nothing came within {self.config.start:g} s", _LOOK)

    def _receive(self, link: Datagrams, now: int) -> None:
        for data, peer in link.read_from():
            try:
                numbers = self._sample(data, peer[0])
            except ValueError as error:
                self._sampled.bad(str(error))
                continue
            if numbers is None:
                continue
            missed = self._missed(numbers)
            if missed < 0:
                self._sampled.bad("a sample came twice, or after a newer one")
                continue
            self._gaps += missed
            stamp = now
            if self.config.time is not None:
                stamp = self._clock.stamp(round(numbers[self.config.time] * 1e9), now)
            values = [numbers[place] for place in self._numbers.places]
            self._sampled.take(values, self.state_arrays, now, missed, stamp)
        self._sampled.listen(now)

    def _sample(self, data: bytes, host: str) -> dict[str, float] | None:
        """The numbers of a whole sample by place; None: it isn't whole yet, or of another host. Raises ValueError."""
        if self._peer not in (None, host):
            self._strangers += 1
            return None
        read = of_json if self.config.format == "json" else of_osc
        try:
            found = read(data, self._wanted)
        except (UnicodeDecodeError, RecursionError):
            raise ValueError("a message isn't text") from None
        if self.config.format == "json":
            self._found = found
            if lacks := [place for place in self._wanted if place not in found]:
                raise ValueError(f"a message has no number at '{lacks[0]}'")
        else:
            self._found |= found
            if len(self._found) < len(set(self._wanted)):
                return None
        self._peer = host
        whole, self._found = self._found, {}
        return whole

    def _missed(self, numbers: dict[str, float]) -> int:
        """How many samples before this one are missing; -1: it is an old one."""
        if self.config.sequence is None:
            return 0
        number, before = numbers[self.config.sequence], self._sequence
        if before is None or number < before - _BACK:
            self._sequence = number
            return 0
        if number <= before:
            return -1
        self._sequence = number
        return round(number - before) - 1

    def metrics(self) -> dict[str, object]:
        """Returns the host that counts, samples that its sequence says are missing, and datagrams of other hosts."""
        return {"sender": self._peer, "gaps": self._gaps, "strangers": self._strangers}
