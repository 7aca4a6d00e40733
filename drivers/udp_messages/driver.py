"""A program, a phone or a glove's own streamer that sends numbers by UDP, as a device."""

from __future__ import annotations

from typing import Final

from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.linked import Linked
from srl.drivers.numbers.sampled import Sampled
from srl.drivers.numbers.signals import Numbers
from srl.drivers.timeout import remaining
from srl.drivers.udp_messages.config import UdpMessagesConfig
from srl.drivers.udp_messages.protocol import LONGEST, of_json, of_osc
from srl.drivers.udp_messages.sender_clock import SenderClock
from srl.runtime.contracts.driver import DeviceConfig, Sensor

_LOOK: Final = "Look at the sender's address and port, and at a firewall"
_MOST: Final = 64  # datagrams that are looked at in one cycle
_BACK: Final = 1000  # samples by which a sequence may go back: more is a sender that began anew


class UdpMessages(Linked[Datagrams], Sensor):
    """JSON or OSC by UDP. The network isn't protected: anybody in it can pretend to be the sender.

    States: those of `signals`, each (n,). A JSON datagram is a sample if it has all numbers. Of OSC each message may
    bring some: what is known is as old as the oldest of its numbers. What isn't of the first sender, host and port,
    doesn't count.
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
        config = self.config
        # Messages of OSC are parts of samples, and their number says nothing.
        regular = config if config.format == "json" else config.model_copy(update={"rate": 0.0})
        known = config.sequence is not None  # a sample that is lost is known to be lost
        self._sampled = Sampled(regular, self._place, self.health, self._numbers, lossless=known)
        self._peer: tuple[str, int] | None = None
        self._parts: dict[str, tuple[float, int]] = {}  # of OSC: the newest number of each place, and when it came, ns
        self._sequence: float | None = None
        self._clock = SenderClock()
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
                    if self._sample(data, peer, 0) is not None:
                        self._parts.clear()
                        return
                except ValueError as error:
                    why = str(error)
        if came:
            lacks = [place for place in self._wanted if place not in self._parts]
            why = why or ("none is of the sender" if self._strangers else f"it has no number at '{lacks[0]}'")
            raise self._error(f"{came} datagrams came, and no sample: {why}", "Look at 'format' and 'signals'")
        raise self._error(f"nothing came within {self.config.start:g} s", _LOOK)

    def _receive(self, link: Datagrams, now: int) -> None:
        came = link.read_from()
        if len(came) > _MOST:
            self._sampled.bad(f"{len(came)} datagrams came at once; the newest {_MOST} are looked at")
        for data, peer in came[-_MOST:]:
            try:
                found = self._sample(data, peer, now)
                if found is None:
                    continue
                numbers, stamp = found
                missed = self._missed(numbers)
                if self.config.time is not None:
                    stamp = self._clock.stamp(numbers[self.config.time], now)
            except ValueError as error:
                self._sampled.bad(str(error))
                continue
            self._gaps += missed
            values = [numbers[place] for place in self._numbers.places]
            self._sampled.take(values, self.state_arrays, now, missed, stamp)
        if problem := self._clock.problem:
            raise self._lost(problem, "Look at 'time': it must be in s, by a clock that runs")
        self._sampled.listen(now)

    def _sample(self, data: bytes, peer: tuple[str, int], now: int) -> tuple[dict[str, float], int | None] | None:
        """The numbers by place, and when the oldest of them came (ns), where they came apart.

        None: it isn't whole yet, or of another sender. Raises ValueError: it is none.
        """
        if self._peer not in (None, peer) or self.config.sender not in (None, peer[0]):
            self._strangers += 1
            return None
        if len(data) > LONGEST:
            raise ValueError(f"a datagram has {len(data)} bytes, at most {LONGEST} are read")
        read = of_json if self.config.format == "json" else of_osc
        try:
            found = read(data, self._wanted)
        except (UnicodeDecodeError, RecursionError):
            raise ValueError("a message isn't text") from None
        if self.config.format == "json":
            if lacks := [place for place in self._wanted if place not in found]:
                raise ValueError(f"a message has no number at '{lacks[0]}'")
            self._peer = peer
            return found, None
        self._parts |= {place: (number, now) for place, number in found.items()}
        if not found or len(self._parts) < len(set(self._wanted)):
            return None
        self._peer = peer
        return {place: number for place, (number, _) in self._parts.items()}, min(at for _, at in self._parts.values())

    def _missed(self, numbers: dict[str, float]) -> int:
        """How many samples before this one are missing. Raises ValueError: it is an old one."""
        if self.config.sequence is None:
            return 0
        number, before, modulus = numbers[self.config.sequence], self._sequence, self.config.sequence_modulus
        if not 0 <= number < (1 << 53 if modulus is None else modulus) or number != int(number):
            raise ValueError(f"its sequence, {number:g}, is no whole number that counts up")
        step = 1.0 if before is None else number - before if modulus is None else (number - before) % modulus
        if modulus is not None and step > modulus / 2:
            step -= modulus
        if -_BACK <= step <= 0:
            raise ValueError("a sample came twice, or after a newer one")
        self._sequence = number
        return max(round(step) - 1, 0)

    def metrics(self) -> dict[str, object]:
        """Returns the host that counts, samples that its sequence says are missing, and datagrams of other hosts."""
        return {"sender": self._peer, "gaps": self._gaps, "strangers": self._strangers}
