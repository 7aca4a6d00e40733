"""What devices of plain numbers share: the age of a sample, silence, values that stand still, another rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from srl.drivers.numbers.signals import Numbers, NumbersConfig
from srl.drivers.rate import Rate
from srl.drivers.streamtime import LATE, Lateness, StreamTime
from srl.runtime.contracts.driver import Health
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array

_SENDER: Final = "Look at the sender, its supply and its cable or network"


class Sampled:
    """Takes the samples of one connection, in their order.

    A sample's stamp is its arrival minus `latency`. With `rate` it follows from the sample's number, so that what
    waited in a buffer is as old as it is.
    """

    def __init__(self, config: NumbersConfig, place: str, health: Health, numbers: Numbers, lossless: bool) -> None:
        """`lossless`: no sample gets lost unseen on the way, as over TCP."""
        self._config, self._place, self._health, self._numbers = config, place, health, numbers
        self._time = StreamTime(config.rate, learn=True, lossless=lossless) if config.rate else None
        self._rate = Rate(config.rate) if config.rate else None
        self._late = Lateness()
        self._count = 0
        self._heard = self._fresh = -1  # ns, when a sample came; when its numbers were other ones
        self._newest: Sequence[float] = ()

    def take(
        self, numbers: list[float], states: Mapping[str, Array], now: int, missed: int = 0, stamp: int | None = None
    ) -> None:
        """Takes a sample that came by `now` (ns).

        `missed`: samples before it that are known to be lost. `stamp`: ns, when it was taken, if its sender says so.

        Raises DeviceLostError: it brings more or fewer than `rate`, or they have been late for long.
        """
        health, config = self._health, self._config
        self._count += 1 + missed
        self._heard = now
        late = 0
        if stamp is None and self._time is not None:
            stamp = self._time.stamp(self._count, now)
            late = self._time.delay
            self._late.check(late, now, self._place, health)
        # A window that ends in a late sample would say nothing of the rate.
        if self._rate is not None and late < LATE and (found := self._rate.wrong(self._count, now)) is not None:
            problem = f"it brings {found:.0f} samples a second, and the profile says {config.rate:g}"
            health.lost(problem)
            raise DeviceLostError(self._place, problem, f"Correct 'rate'. {_SENDER}")
        if numbers != self._newest or self._fresh < 0:
            self._newest, self._fresh = numbers, now
        if config.frozen is not None and now - self._fresh > config.frozen * 1e9:
            health.message = "its numbers stand still to the last digit"
            health.errors += 1
            return
        if problem := self._numbers.take(numbers, states):
            health.message = problem
            health.errors += 1
            return
        health.frames += 1
        health.message = ""
        health.stamp = max(health.stamp, (now if stamp is None else stamp) - round(config.latency * 1e9))

    def bad(self, why: str) -> None:
        """Notes something that was no sample."""
        self._health.errors += 1
        self._health.message = why

    def listen(self, now: int) -> None:
        """Called in each cycle. Raises DeviceLostError: nothing has come for `silence`."""
        if self._heard < 0:
            self._heard = now
        if now - self._heard > self._config.silence * 1e9:
            problem = f"no sample for {self._config.silence:g} s"
            self._health.lost(problem)
            raise DeviceLostError(self._place, problem, _SENDER)
