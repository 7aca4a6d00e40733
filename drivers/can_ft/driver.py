"""The RFT as a device: identified and set up at open, then each cycle takes the newest record of its stream."""

from __future__ import annotations

import time
from typing import Final, Literal

import can
import numpy as np
from pydantic import Field, field_validator

from srl.drivers.can_ft.protocol import (
    CUTOFFS,
    DIVISORS,
    ERRORS,
    RATES,
    RECEIVER,
    RESPONSES,
    Command,
    Parser,
    Record,
    Response,
    command,
)
from srl.drivers.canbus import CanLink, frame_bits, open_can, shared_bus
from srl.drivers.counts import CountsConfig
from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Linked
from srl.drivers.timeout import remaining
from srl.runtime.contracts.driver import DeviceConfig, Sensor, Traffic
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import WRENCH

TRIES: Final = 3
ANSWER: Final = 0.3  # s
QUIET: Final = 0.03  # s without a frame after which the stream has stopped
ASK_AGAIN: Final = 100_000_000  # ns, the shortest time without a record before the stream is requested again
PERIODS: Final = 5  # and the fewest periods for this (4)
GONE: Final = 2_000_000_000  # ns without a record after which the sensor counts as lost
LOOK: Final = 0.25  # s of records from which a zero is taken
FEWEST: Final = 5
STEADY: Final = np.array([2.0] * 3 + [0.2] * 3)  # N, N m, peak to peak while a zero is taken
_REMEDY: Final = (
    "Check the bus (1 Mbit/s, 120 ohm at both ends; the sensor has no terminator of its own), its supply and 'ids'"
)


class CanFtConfig(DeviceConfig):
    """Options in the profile."""

    port: str = Field(description="can://INTERFACE/CHANNEL, e.g. can://socketcan/can0")
    model: str | None = Field(None, description="refuse another model; None: take any known one")
    serial: str | None = Field(None, description="refuse a sensor with another serial number")
    counts: CountsConfig | None = Field(None, description="None: by the model's name")
    rate: Literal[10, 20, 50, 100, 200, 333, 500, 1000] = Field(200, description="Hz of records")
    filter: int = Field(0, description="Hz, cutoff of the sensor's low-pass; 0: none")
    bias: bool = Field(False, description="zero at the present load when it is first opened")
    ids: tuple[int, int, int] = Field((RECEIVER, *RESPONSES), description="CAN ids: commands, first half, second half")
    frame: str = Field("sensor", description="frame of the wrench")

    @field_validator("filter")
    @classmethod
    def _known(cls, value: int) -> int:
        if value not in CUTOFFS:
            raise ValueError(f"must be one of {', '.join(str(cutoff) for cutoff in sorted(CUTOFFS))}")
        return value

    @field_validator("ids")
    @classmethod
    def _different(cls, value: tuple[int, int, int]) -> tuple[int, int, int]:
        if len(set(value)) != 3 or not all(0 < number < 256 for number in value):
            raise ValueError("must be three different numbers of 1 to 255")
        return value


class CanFt(Linked[CanLink], Sensor):
    """A Robotous RFT force/torque sensor on CAN.

    State `wrench` (6,): force (N), then torque (N m), in the frame of the options. The sensor sends neither a counter
    nor a clock. A sample's stamp comes from the interface's own time stamp of its first frame, so frames that waited in
    a queue show their age. A record with an overload isn't used: the last good one becomes old. Source: sheet
    robotous_rft_can.
    """

    Config = CanFtConfig
    summary = "Robotous RFT 6-axis force/torque sensor (CAN, any python-can interface)"
    usb = ("16d0",)  # of slcan adapters
    gives = ("wrench",)
    max_age = 0.1

    def __init__(self, name: str, config: CanFtConfig) -> None:
        super().__init__(name, config)
        self.config: CanFtConfig = config
        self.states = (Signal(name="wrench", shape=(6,), unit="N, N m", frame=config.frame, labels=WRENCH),)
        ids = dict(zip(config.ids, ("commands", "first halves of records", "second halves of records"), strict=True))
        self.traffic = Traffic(shared_bus(config.port), 1e6, 0.0, 2 * frame_bits(8) * config.rate, ids)
        self._parser = Parser(config.ids[1], config.ids[2])
        self._time = DeviceTime(1)
        self._first_at = 0.0  # the interface's time of the first half that waits for its second
        self._scale: Array = np.ones(6)
        self._zero: Array | None = None  # N, N m; kept after a loss, when the load may have changed
        self._names: dict[str, str] = {}
        self._heard = self._asked = -1
        self._overloads = 0
        self._asks = 0
        period = 1_000_000_000 // config.rate
        self._timeout = max(ASK_AGAIN, PERIODS * period)
        # A sensor that lost power forgets these settings, so they are sent again with each new stream request.
        cutoff = CUTOFFS.index(config.filter)
        self._settings = (
            command(Command.SET_FILTER, 1 if cutoff else 0, cutoff),
            command(Command.SET_RATE, RATES.index(config.rate, 1)),
        )
        self._unbias = (command(Command.BIAS, 0),)  # another program's zero may be in it; ours is taken here

    # -- lifecycle

    def connect(self) -> CanLink:
        filters = [{"can_id": number, "can_mask": 0x7FF} for number in self.config.ids[1:]]
        return open_can(self.config.port, place=self._place, filters=filters)

    def _set_up(self, link: CanLink) -> None:
        """Blocks up to 5 s."""
        self._silence(link)
        self._identify(link)
        for setting in self._settings:
            self._set(link, setting)
        for frame in self._unbias:
            self._send(link, frame)
        self._stream(link)
        if self.config.bias and self._zero is None:
            self._zero = self._unloaded(link)
        self._time.restart()
        self._heard = self._asked = -1
        self.health.message = self._names["model"]

    def _receive(self, link: CanLink, now: int) -> None:
        if self._heard < 0:
            self._heard = self._asked = now
        newest, at = self._take(link.read())
        if newest is not None:
            self._heard = now
            self._fill(newest, at, now)
        elif now - self._heard > GONE:
            raise self._lost(f"no records for {GONE / 1e9:g} s", _REMEDY)
        elif now - max(self._heard, self._asked) > self._timeout:
            self._asked = now
            self._asks += self._ask_again(link)
            self.health.message = f"no records; the stream was asked for again {self._asks} times"

    def _end(self, link: CanLink) -> None:
        link.write(self._message(command(Command.STOP)))

    def metrics(self) -> dict[str, object]:
        """Returns model, serial number, firmware; records with an overload; number of repeated stream requests."""
        return self._names | {"overloads": self._overloads, "asked_again": self._asks}

    # -- cycle

    def _take(self, messages: list[can.Message]) -> tuple[Record | None, float]:
        """Returns the newest record, and the interface's time of its first frame."""
        newest, at = None, 0.0
        for message in messages:
            if message.is_extended_id or message.is_remote_frame:
                continue
            for found in self._parser.feed(message.arbitration_id, message.data):
                if isinstance(found, Record):
                    newest, at = found, self._first_at
            if message.arbitration_id == self._parser.first:
                self._first_at = message.timestamp
        self._count()
        return newest, at

    def _fill(self, record: Record, at: float, now: int) -> None:
        stamp = self._time.stamp(int(at * 1e9), now) if at > 0 else now
        if record.overload:
            self._overloads += 1
            self._count()
            self.health.message = f"overload of {', '.join(record.overloaded)}"
            return
        wrench = self.state_arrays["wrench"]
        np.multiply(record.counts, self._scale, out=wrench)
        if self._zero is not None:
            wrench -= self._zero
        self.health.stamp = stamp
        self.health.message = self._names["model"]

    def _count(self) -> None:
        health, parser = self.health, self._parser
        health.frames, health.errors, health.resyncs = parser.frames, parser.errors + self._overloads, parser.resyncs

    def _ask_again(self, link: CanLink) -> bool:
        frames = (*self._settings, *self._unbias, command(Command.START))
        return all([link.write(self._message(frame)) for frame in frames])

    def _message(self, data: bytes) -> can.Message:
        return can.Message(arbitration_id=self.config.ids[0], data=data, is_extended_id=False)

    # -- opening

    def _silence(self, link: CanLink) -> None:
        """Ends a stream that an earlier program left on, and discards the frames on their way."""
        for _ in range(TRIES):
            self._send(link, command(Command.STOP))
            for _ in remaining(ANSWER):
                if not link.read_wait(QUIET):
                    self._parser.reset()
                    return
        raise self._error("the sensor keeps sending after the command to stop", _REMEDY)

    def _identify(self, link: CanLink) -> None:
        config = self.config
        model = self._ask(link, command(Command.MODEL)).text
        serial = self._ask(link, command(Command.SERIAL)).text
        firmware = self._ask(link, command(Command.FIRMWARE)).text
        self._names = {"model": model, "serial": serial, "firmware": firmware}
        if config.model is not None and model != config.model:
            raise self._error(f"this sensor is a '{model}', the profile says '{config.model}'", f"Set 'model: {model}'")
        if config.serial is not None and serial != config.serial:
            raise self._error(
                f"this sensor's serial number is '{serial}', the profile says '{config.serial}'",
                "Plug in that one, or correct 'serial'",
            )
        if config.counts is not None:
            per_force, per_torque = config.counts.force, config.counts.torque
        elif model in DIVISORS:
            per_force, per_torque = DIVISORS[model]
        else:
            raise self._error(
                f"the counts of the model '{model}' aren't known; known: {', '.join(DIVISORS)}",
                "Give 'counts' in the profile, from the sensor's manual",
            )
        self._scale = np.array([1 / per_force] * 3 + [1 / per_torque] * 3)

    def _set(self, link: CanLink, setting: bytes) -> None:
        values = self._ask(link, setting).values
        if values[0] != 1:
            what = "filter" if setting[0] == Command.SET_FILTER else "rate"
            why = ERRORS.get(values[1], f"error {values[1]}")
            raise self._error(f"the sensor refused the {what}: {why}", f"Choose another '{what}'")

    def _stream(self, link: CanLink) -> None:
        for _ in range(TRIES):
            self._send(link, command(Command.START))
            for left in remaining(ANSWER + 2 / self.config.rate):
                if self._take(link.read_wait(left))[0] is not None:
                    return
        raise self._error("the sensor doesn't stream", _REMEDY)

    def _unloaded(self, link: CanLink) -> Array:
        """Returns the mean of the present readings, (6,) N, N m.

        The driver subtracts it, because the sensor's own bias isn't acknowledged and is lost with its power.
        """
        found: list[tuple[int, ...]] = []
        for left in remaining(max(LOOK, 2 * FEWEST / self.config.rate)):
            record, _ = self._take(link.read_wait(left))
            if record is not None and record.overload:
                raise self._error(f"overload of {', '.join(record.overloaded)}: no zero can be taken", "Unload it")
            if record is not None:
                found.append(record.counts)
        if len(found) < FEWEST:
            raise self._error("its records stopped while a zero was taken", _REMEDY)
        load = np.array(found) * self._scale
        if np.any(np.ptp(load, axis=0) > STEADY):
            raise self._error(
                "the load moves, so it can't be taken for zero",
                "Let go of the sensor and of what is mounted on it; then open it again",
            )
        mean: Array = load.mean(axis=0)
        return mean

    def _ask(self, link: CanLink, frame: bytes) -> Response:
        heard = 0
        for _ in range(TRIES):
            self._send(link, frame)
            for left in remaining(ANSWER):
                for message in link.read_wait(left):
                    heard += 1
                    for found in self._parser.feed(message.arbitration_id, message.data):
                        if isinstance(found, Response) and found.command == frame[0]:
                            return found
        name = Command(frame[0]).name
        what = f"{heard} frames of other content" if heard else "no frame"
        first, second = self.config.ids[1:]
        raise self._error(f"expected an RFT's answer to {name} on ids {first:#x} and {second:#x}, got {what}", _REMEDY)

    def _send(self, link: CanLink, frame: bytes) -> None:
        deadline = time.monotonic() + ANSWER
        while not link.write(self._message(frame)):
            if time.monotonic() > deadline:
                raise self._error("the bus takes no frame: nobody acknowledges it", _REMEDY)
            time.sleep(0.001)
