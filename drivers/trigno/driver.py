"""The Trigno base station as a device, through its SDK server."""

from __future__ import annotations

import time
from typing import Final
from urllib.parse import parse_qs, urlsplit

import numpy as np
from pydantic import Field, field_validator

from srl.drivers.linked import Addressed
from srl.drivers.streamtime import Lateness, StreamTime
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.drivers.trigno.envelope import Envelope
from srl.drivers.trigno.protocol import COMMAND_PORT, EMG_OFFSET, RATE, SLOTS, Answers, Samples, command, refused
from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Array, Signal

ANSWER: Final = 3.0  # s for an answer
FIRST: Final = 3.0  # s for the first sample after START (§2: data begin within about 2 s)
SILENT: Final = round(0.1 * RATE)  # samples of exactly 0 after which a sensor counts as lost (§5)
GONE: Final = 5_000_000_000  # ns without a sample after which the server is connected and started anew
WRONG: Final = round(0.25 * RATE)  # samples in blocks with impossible voltages, if over a fifth of all samples
_REMEDY: Final = "Start the Trigno Control Utility on its PC and check address and firewall"


class TrignoConfig(DeviceConfig):
    """Options of a base station."""

    port: str = Field(description="tcp://HOST[:50040], of the PC with the Trigno Control Utility")
    channels: dict[str, int] = Field(min_length=1, description="muscle: its sensor's EMG slot, 1 to 16")
    window: float = Field(0.1, ge=0.01, le=2, description="s over which the envelope is taken")
    latency: float = Field(0.0, ge=0, le=0.5, description="s that the radio and the base station need; not published")
    block: int = Field(0, ge=0, le=512, description="keep the newest so many samples in a row of their own; 0: none")

    @field_validator("channels")
    @classmethod
    def _slots(cls, channels: dict[str, int]) -> dict[str, int]:
        for name, slot in channels.items():
            if not 1 <= slot <= SLOTS:
                raise ValueError(f"'{name}' is in slot {slot}; there are slots 1 to {SLOTS}")
        if len(set(channels.values())) < len(channels):
            raise ValueError("two muscles have the same slot")
        return channels


class Trigno(Addressed, Sensor):
    """A Trigno base station with up to 16 EMG channels.

    States: `emg` (n,) V, the newest sample; `envelope` (n,) V, RMS of the window; `present` (n,), 0 or 1.

    With `block: k` also `samples` (k, n) V, the newest k samples, oldest first, and `count` (1,), the number of samples
    so far. So a recording loses none as long as a cycle brings at most k samples (27 come at a time, 2000 a second).

    A sample's time is its number divided by the rate, anchored at the sample with the smallest delay. The server sends
    no times (§4). Over TCP none is lost on the way, so late samples stay as old as they are: they wait somewhere. After
    5 s of them the server is connected anew; so it is where the server itself has left samples out. A sensor out of
    reach sends zeros (§5): then it isn't `present`, and the device becomes stale.
    """

    Config = TrignoConfig
    summary = "Delsys Trigno wireless EMG, up to 16 channels"
    gives = ("emg", "envelope", "present", "samples", "count")
    max_age = 0.15

    def __init__(self, name: str, config: TrignoConfig) -> None:
        super().__init__(name, config)
        labels, n = tuple(config.channels), len(config.channels)
        self.states = (
            Signal(name="emg", shape=(n,), unit="V", labels=labels),
            Signal(name="envelope", shape=(n,), unit="V", labels=labels),
            Signal(name="present", shape=(n,), unit="1", labels=labels),
        )
        if config.block:
            self.states += (
                Signal(name="samples", shape=(config.block, n), unit="V", slots=True, components=(labels,)),
                Signal(name="count", shape=(1,), unit="1"),
            )
        self._config = config
        self._columns = [slot - 1 for slot in config.channels.values()]
        self._names = np.array(labels)
        self._control: Transport | None = None
        self._emg: Transport | None = None
        self._answers, self._heard = Answers(), list[str]()
        self._parser = Samples()
        self._envelope = Envelope(n, max(round(config.window * RATE), 1))
        self._zeros = np.zeros(n, int)
        self._clock, self._late = StreamTime(RATE, lossless=True), Lateness()
        self._count = self._wrong = 0
        self._heard_at = -1  # ns: time of the newest data

    # -- lifecycle

    def open(self) -> None:
        self.close()
        self._parser, self._answers, self._heard = Samples(), Answers(), []
        control, emg = self._addresses()
        try:
            self._control = open_transport(control, place=self._place)
            self._greet()
            self._prepare()
            self._emg = open_transport(emg, place=self._place)  # before START (§3)
            self._ask("START")
            self._await_samples()
        except DeviceError:
            self.close()
            raise
        self._clock, self._late = StreamTime(RATE, lossless=True), Lateness()
        self._count = self._wrong = 0
        self._heard_at = -1
        self._zeros[:] = 0
        self.health.opened()
        self.health.message = ""

    def read(self, now: int) -> None:
        if self._emg is None or self._control is None:
            raise self._not_open()
        try:
            data = self._emg.read()
            if self._control.unsent() == 0:
                self._control.read()
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        if data or self._heard_at < 0:
            self._heard_at = now
        if not data:
            if now - self._heard_at > GONE:
                raise self._lost(f"no samples for {GONE / 1e9:g} s", "It is connected and started anew")
            return
        errors = self._parser.errors
        samples = self._parser.feed(data)[:, self._columns]
        if len(samples):
            self._wrong = max(self._wrong - len(samples) // 4, 0)
            self._take(samples, now)
            return
        self.health.errors += self._parser.errors - errors
        self._wrong += self._parser.errors - errors
        if self._wrong > WRONG:
            self.health.lost("the stream is out of step")
            raise DeviceLostError(self._place, "what it sends are no electrode's voltages", "It is connected anew")

    def close(self) -> None:
        control, self._control = self._control, None
        emg, self._emg = self._emg, None
        was, self.health.connected = self.health.connected, False
        if control is not None:
            try:
                if was:
                    control.write(command("STOP"))
            except DeviceError:
                pass  # it is gone, so there is nothing to report
            control.close()
        if emg is not None:
            emg.close()

    # -- cycle

    def _take(self, samples: Array, now: int) -> None:
        self.health.frames += len(samples)
        self._count += len(samples)
        self._envelope.take(samples)
        state = self.state_arrays
        state["emg"][:] = samples[-1]
        state["envelope"][:] = self._envelope.value
        if self._config.block:
            kept, new = state["samples"], samples[-self._config.block :]
            kept[: len(kept) - len(new)] = kept[len(new) :].copy()
            kept[len(kept) - len(new) :] = new
            state["count"][0] = self._count
        present = self._is_present(samples)
        state["present"][:] = present
        stamp = self._clock.stamp(self._count, now) - round(self._config.latency * 1e9)
        if present.all():
            self.health.stamp = stamp
            self.health.message = ""
        else:
            gone = ", ".join(self._names[~present])
            self.health.message = f"no signal from {gone}: out of reach, or its battery is empty"
        self._late.check(self._clock.delay, now, self._place, self.health)

    def _is_present(self, samples: Array) -> np.ndarray:
        zero = samples == 0
        ends = zero.all(axis=0)
        # Number of zeros at the end of the new samples: all of them, or those after the last non-zero value.
        trailing = np.where(ends, len(samples), np.argmin(zero[::-1], axis=0))
        self._zeros = np.where(ends, self._zeros + trailing, trailing)
        return self._zeros < SILENT

    # -- opening

    def _addresses(self) -> tuple[str, str]:
        try:
            parts = urlsplit(self._config.port)
            host, port = parts.hostname, parts.port or COMMAND_PORT
            emg = int(parse_qs(parts.query).get("emg", [str(port + EMG_OFFSET)])[0])
        except ValueError:
            host = None
        if parts.scheme != "tcp" or not host or parts.path not in ("", "/"):
            raise self._error(f"'{self._config.port}' isn't tcp://HOST", "E.g. tcp://192.168.1.30")
        return f"tcp://{host}:{port}", f"tcp://{host}:{emg}"

    def _greet(self) -> None:
        banner = self._next(ANSWER)
        if "Delsys Trigno" not in banner:
            got = f"'{banner[:40]}'" if banner else "nothing"
            raise self._error(f"expected a Trigno server's greeting, got {got}", _REMEDY)

    def _prepare(self) -> None:
        assert self._control is not None
        self._control.write_all(command("STOP"), ANSWER)  # ends what an earlier client left running
        self._next(ANSWER)
        for text in ("ENDIAN LITTLE", "BACKWARDS COMPATIBILITY OFF", "UPSAMPLE ON"):
            self._ask(text)
        owner: dict[int, int] = {}  # slot: sensor
        for sensor in range(1, SLOTS + 1):
            if self._ask(f"SENSOR {sensor} PAIRED?") != "YES" or self._ask(f"SENSOR {sensor} ACTIVE?") != "YES":
                continue
            start = self._number(f"SENSOR {sensor} STARTINDEX?", sensor)
            for slot in range(start, start + self._number(f"SENSOR {sensor} EMGCHANNELCOUNT?", 1)):
                owner[slot] = sensor
        missing = [f"{name} (slot {slot})" for name, slot in self._config.channels.items() if slot not in owner]
        if missing:
            found = ", ".join(str(slot) for slot in sorted(owner)) or "none"
            raise self._error(
                f"no sensor is on for {', '.join(missing)}; slots with one: {found}",
                "Take the sensors off their charger, pair them, or correct 'channels'",
            )

    def _number(self, text: str, default: int) -> int:
        answer = self._ask(text)
        return int(answer) if answer.isdigit() else default

    def _await_samples(self) -> None:
        assert self._emg is not None
        for left in remaining(FIRST):
            if len(self._parser.feed(self._emg.read_wait(left))):
                return
        raise self._error(f"no samples within {FIRST:g} s after START", _REMEDY)

    def _ask(self, text: str) -> str:
        assert self._control is not None
        self._heard.clear()
        self._control.write_all(command(text), ANSWER)
        answer = self._next(ANSWER)
        if not answer:
            raise self._error(f"'{text}' wasn't answered", _REMEDY)
        if refused(answer):
            raise self._error(
                f"'{text}' was refused: {answer}",
                "Close other programs that use the base station; stop a measurement that runs in the utility",
            )
        return answer

    def _next(self, timeout: float) -> str:
        assert self._control is not None
        deadline = time.monotonic() + timeout
        while not self._heard and (left := deadline - time.monotonic()) > 0:
            self._heard += self._answers.feed(self._control.read_wait(left))
        return self._heard.pop(0) if self._heard else ""
