"""The Net F/T as a device: identified at open, then each cycle takes the newest record of its stream."""

from __future__ import annotations

import contextlib
from typing import Final

import numpy as np

from srl.drivers.ati_netft import status
from srl.drivers.ati_netft.config import Address, AtiNetFtConfig, address
from srl.drivers.ati_netft.identify import identify, set_rate
from srl.drivers.ati_netft.protocol import Parser, Record, Request, request
from srl.drivers.ati_netft.settings import Settings
from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Linked
from srl.drivers.timeout import remaining
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import WRENCH

TRIES: Final = 10  # requests may get lost; public drivers request as often (1.1)
ANSWER: Final = 0.2  # s for the first record after a request
ASK_AGAIN: Final = 100_000_000  # ns without a record after which the stream is requested again
GONE: Final = 2_000_000_000  # ns without a record after which the sensor counts as lost
LOOK: Final = 0.2  # s of records used to judge a bias
_WRAP: Final = 1 << 32
_BEGINNING: Final = 100  # greatest sequence number that counts as the beginning of a stream
_RESYNC: Final = 20  # consecutive records out of order after which the order is established anew
_OVERTAKEN: Final = 100  # samples by which a datagram may be late
BIASED: Final = 2.0  # of its rating: what a sensor can give, whose zero may be anywhere in it
_STEADY: Final = np.array([2.0] * 3 + [0.2] * 3)  # N, N m: used if the ranges aren't known
_REMEDY: Final = "Check the address, the cable and the power, and that no other program reads this sensor"


class AtiNetFt(Linked[Datagrams], Sensor):
    """An ATI Net F/T or Ethernet Axia force/torque sensor.

    State `wrench` (6,): force (N), then torque (N m), in the frame of the options. A sample's stamp comes from the
    sensor's own sample counter if its rate is known. A record with a serious status (above all saturation) isn't used:
    the last good one becomes old. Source: sheet ati_ft, 1.
    """

    Config = AtiNetFtConfig
    summary = "ATI Net F/T or Ethernet Axia: 6-axis force/torque (RDT over UDP)"
    gives = ("wrench",)
    max_age = 0.1

    def __init__(self, name: str, config: AtiNetFtConfig) -> None:
        super().__init__(name, config)
        self.config: AtiNetFtConfig = config
        self.states = (Signal(name="wrench", shape=(6,), unit="N, N m", frame=config.frame, labels=WRENCH),)
        self._parser = Parser()
        self._settings = Settings("", 1e-6, 1e-6)
        self._family: str = config.family or "net-box"
        self._time: DeviceTime | None = None
        self._scale: Array = np.full(6, 1e-6)
        self._sequence: int | None = None
        self._sample: int | None = None  # the newest count, kept after a loss in order to notice a restart
        self._asked_anew = False  # a stream was requested, so its records begin again at 1
        self._late = 0  # consecutive records out of order
        self._heard = self._asked = -1
        self._wrong = 0  # records discarded for their status or their order
        self._missed = 0
        self._asks = 0
        self._latched = False
        self._biased = False

    # -- lifecycle

    def connect(self) -> Datagrams:
        where = address(self.config.port, self._place)
        self._settle(where)
        return open_datagrams(where.url, place=self._place)

    def _set_up(self, link: Datagrams) -> None:
        """Blocks up to 10 s."""
        first = self._start(link)
        if _older(first.sample, self._sample):
            self._biased = False  # it has lost power since, and its bias with it
        self._sample = first.sample
        if self.config.reset_latch:
            self._request(link, Request.RESET_LATCH)
            self._start(link)
        if self.config.bias and not self._biased:
            self._zero(link)
        self._heard = self._asked = -1

    def _receive(self, link: Datagrams, now: int) -> None:
        if self._heard < 0:
            self._heard = self._asked = now
        newest = self._take(link.read())
        if newest is not None:
            self._heard = now
            self._fill(newest, now)
        elif now - self._heard > GONE:
            raise self._lost(f"no records for {GONE / 1e9:g} s", _REMEDY)
        elif now - self._heard > ASK_AGAIN and now - self._asked > ASK_AGAIN:
            self._asked = now
            self._asks += self._request(link, Request.START)
            self.health.message = f"no records; the stream was asked for again {self._asks} times"

    def recover(self, now: int) -> None:
        """Resets the latch of the monitor conditions, and requests the stream again, because the reset ends it."""
        if self._link is not None:
            with contextlib.suppress(DeviceError):  # the next read reports a lost link
                self._request(self._link, Request.RESET_LATCH)
                self._request(self._link, Request.START)

    def _end(self, link: Datagrams) -> None:
        link.write(request(Request.STOP))

    def metrics(self) -> dict[str, object]:
        """Returns the product, missing and discarded records, repeated requests, and the latch."""
        return {
            "product": self._settings.product,
            "missed": self._missed,
            "rejected": self._wrong,
            "asked_again": self._asks,
            "latched": self._latched,
        }

    # -- cycle

    def _take(self, datagrams: list[bytes]) -> Record | None:
        """Returns the newest record in order, healthy or not; counts the missing ones."""
        newest = None
        for datagram in datagrams:
            for record in self._parser.feed(datagram):
                if self._in_order(record):
                    newest = record
                else:
                    self._wrong += 1
        self._count()
        return newest

    def _in_order(self, record: Record) -> bool:
        if self._sequence is not None:
            step = (record.sequence - self._sequence) % _WRAP
            if step == 0 or step > _WRAP // 2:
                self._late += 1
                # Records from before the last request may still come first. After them the sequence begins anew.
                begins = self._asked_anew and record.sequence <= _BEGINNING
                if not begins and self._late < _RESYNC:
                    return False
                step = 1
            self._missed += step - 1
        self._late = 0
        self._asked_anew &= record.sequence > _BEGINNING
        self._sequence = record.sequence
        return True

    def _fill(self, record: Record, now: int) -> None:
        if _older(record.sample, self._sample):
            self._sequence = None
            raise self._lost("the sensor has restarted; its bias and its settings may be others", "Check its power")
        self._sample = record.sample
        # Bad records are counted, too: the clocks' offset must be known when the sensor is well again.
        stamp = now if self._time is None else self._time.stamp(record.sample, now)
        self._latched = bool(record.status & status.LATCHED)
        wrong = status.errors(record.status, self._family) if record.status else ()
        if wrong:
            self._wrong += 1
            self._count()
            self.health.message = f"{'; '.join(wrong)} (status {record.status:08x})"
            return
        np.multiply(record.counts, self._scale, out=self.state_arrays["wrench"])
        self.health.stamp = stamp
        self.health.message = "a monitor condition is latched" if self._latched else self._settings.product

    def _count(self) -> None:
        self.health.frames = self._parser.frames
        self.health.errors = self._parser.errors + self._wrong

    def _request(self, link: Datagrams, command: Request) -> bool:
        self._asked_anew |= command is Request.START
        return link.write(request(command))

    # -- opening

    def _settle(self, where: Address) -> None:
        """Reads the settings from the sensor, or takes them from the profile."""
        config = self.config
        if config.counts is not None:
            found = Settings("", 1 / config.counts.force, 1 / config.counts.torque)
        else:
            found = identify(where, self._place)
        if config.product is not None and config.product.lower() not in found.product.lower():
            raise self._error(
                f"this sensor is '{found.product or 'of unknown name'}', the profile says '{config.product}'",
                "Correct 'product' or the address; without 'counts' the sensor's page tells the name",
            )
        if any(found.transform) != config.transformed:
            set_in_it = ", ".join(f"{v:g}" for v in found.transform) or "unknown"
            raise self._error(
                f"the sensor's tool transform is {set_in_it}, the profile says transformed: {config.transformed}",
                "Set it to zero on the sensor's page; or say `transformed: true`, with `frame` where it turns to",
            )
        if config.rate is not None:
            set_rate(where, config.rate, self._place)
        rate = config.sample_rate or found.sample_rate
        self._settings = found
        self._family = config.family or status.family(found.product)
        self._time = DeviceTime(1e9 / rate, bits=32) if rate else None
        self._scale = np.array([found.force] * 3 + [found.torque] * 3)
        if found.range:
            most = BIASED * np.array(found.range)
            self.ranges["wrench"] = -most, most

    def _start(self, link: Datagrams) -> Record:
        """Requests the stream until its first record comes."""
        heard = 0
        for _ in range(TRIES):
            self._request(link, Request.STOP)
            link.read()  # discards an earlier stream's records
            self._sequence, self._asked_anew = None, False
            self._request(link, Request.START)
            for left in remaining(ANSWER):
                datagrams = link.read_wait(left)
                heard += len(datagrams)
                record = self._take(datagrams)
                if record is not None:
                    return record
        what = f"{heard} datagrams that are no records" if heard else "no records"
        raise self._error(f"the sensor sent {what} though it was asked {TRIES} times", _REMEDY)

    def _zero(self, link: Datagrams) -> None:
        """Applies the sensor's own bias, and checks by records: it isn't acknowledged and may end the stream (1.7)."""
        steady = 0.01 * np.array(self._settings.range) if self._settings.range else _STEADY
        for _ in range(3):
            load = self._look(link)
            if np.any(np.ptp(load, axis=0) > steady):
                raise self._error(
                    "the load moves, so it can't be taken for zero",
                    "Let go of the sensor and of what is mounted on it; it is tried again",
                )
            self._request(link, Request.BIAS)
            self._start(link)
            if np.all(np.abs(self._look(link).mean(axis=0)) <= steady):
                self._biased = True
                return
        raise self._error("the sensor took no bias", "Set 'bias: false' and zero it by its own page")

    def _look(self, link: Datagrams) -> Array:
        """Returns (k, 6) N, N m: healthy records of LOOK seconds."""
        found: list[tuple[int, ...]] = []
        wrong: tuple[str, ...] = ()
        for left in remaining(LOOK):
            record = self._take(link.read_wait(left))
            if record is None:
                continue
            bad = status.errors(record.status, self._family)
            if bad:
                wrong = bad
            else:
                found.append(record.counts)
        if len(found) < 3:
            why = "; ".join(wrong) or "its records stopped"
            raise self._error(f"no bias can be taken: {why}", _REMEDY)
        return np.array(found) * self._scale


def _older(count: int, than: int | None) -> bool:
    """Returns whether a sample counter began anew; late datagrams don't count."""
    if than is None:
        return False
    step = (count - than + _WRAP // 2) % _WRAP - _WRAP // 2
    return step < -_OVERTAKEN
