"""The CyberGlove as a device: identified at open, then each cycle takes the newest record of its stream."""

from __future__ import annotations

import zlib
from math import pi
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from srl.drivers.cyberglove import calibration
from srl.drivers.cyberglove.protocol import BAUDRATE, LABELS, START, STOP, Parser, Record, Reply, assign, query
from srl.drivers.linked import Linked
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.signals import Signal

TRIES: Final = 3  # after power-up the first answer can fail (§7)
ANSWER: Final = 1.0  # s for an answer or the first record; the sheet's drivers wait 0.1 to 2 s
QUIET: Final = 0.15  # s without a byte after which the stream has stopped
RESTART: Final = 1_000_000_000  # ns without a record after which streaming is requested again
_MISSING: Final = "Make it with `srl calibrate PROFILE glove`, or name an existing file"
_REMEDY = "Check the port, that it is an 8-bit CyberGlove II or III, and its power; switch it off and on"


class CyberGloveConfig(DeviceConfig):
    """Options of a glove."""

    port: str = Field(description="link: a serial port's path, tcp://HOST:PORT, spy:FILE:URL")
    sensors: Literal[18, 22] = 22
    calibration: Annotated[KeptFile, FileOption(_MISSING)] | None = Field(
        None, description="file of `srl calibrate`, YAML, or the vendor's .cal; None: an average hand's"
    )
    raw: bool = Field(False, description="give the sensors' own counts, 1 to 255, instead of angles: to calibrate it")
    hand: Literal["right", "left"] = "right"
    settings: str | None = Field(
        None,
        pattern="^[0-9a-f]{8}$",
        description="of the glove's own offsets and gains, that change its counts, as `srl find-port --ask cyberglove` "
        "says; other ones are refused. None: they aren't compared",
    )


class CyberGlove(Linked[Transport], Sensor):
    """A CyberGlove data glove.

    States: `position` (n,), rad, joint angles by sensor name; `buttons` (1,), the wrist switch, 0 or 1. With the option
    `raw`, `raw` (n,), counts of 1 to 255, instead of `position`: a law that expects angles finds none.

    Angles are anatomical (flexion and spreading positive), so both hands give the same values. A sample's `stamp` is
    the time when the loop found it. The glove's own time stamp stays off, because its unit and byte order aren't known
    (§3). If the glove is unplugged from its interface, the device becomes stale: its records are read but not used.
    """

    Config = CyberGloveConfig
    summary = "CyberGlove II/III data glove, 18 or 22 joint angles"
    usb = ("0403:6001",)  # FTDI, in its adapter
    gives = ("position", "raw", "buttons")
    calibrated = "glove"
    max_age = 0.1

    def __init__(self, name: str, config: CyberGloveConfig) -> None:
        super().__init__(name, config)
        self.port = config.port
        self.sensors: int = config.sensors
        self.hand = config.hand
        self._own = config.settings
        labels = LABELS[config.sensors]
        self._raw = config.raw
        given, unit = ("raw", "count") if config.raw else ("position", "rad")
        plausible = (0.0, 255.0) if config.raw else (-pi, pi)  # a byte; no joint of a hand turns further
        self.states = (
            Signal(name=given, shape=(config.sensors,), unit=unit, labels=labels, plausible=plausible),
            Signal(name="buttons", shape=(1,), unit="1", labels=("wrist_switch",)),
        )
        self._calibration_file = config.calibration
        self._calibration = self._load_calibration()  # here, so that `srl check` refuses what a run would
        self.simulated = "calibration" if self._calibration.simulated else ""
        self._parser = Parser(config.sensors)
        # A glove forgets these settings when it is switched off, so a request to restart the stream repeats them.
        self._settings = (assign("N", config.sensors), assign("D", 0), assign("U", 1))
        self._since = -1  # ns: the newest record of any kind, or the newest request to stream
        self._restarts = 0
        self._slow = 0

    # -- lifecycle

    def connect(self) -> Transport:
        return open_transport(self.port, place=self._place, baudrate=BAUDRATE)

    def _set_up(self, link: Transport) -> None:
        self._silence(link)
        self._identify(link)
        self._stream(link)
        self._since = -1
        self.health.message = "" if self._raw else self._calibration.note

    def _receive(self, link: Transport, now: int) -> None:
        data = link.read()
        if self._since < 0:
            self._since = now
        newest = self._take(data) if data else None
        if newest is not None:
            self._since = now
            self._fill(newest, now)
        elif now - self._since > RESTART:
            self._since = now
            self._restarts += link.write(b"".join(self._settings) + START)
            self.health.message = f"no records; streaming was asked for again {self._restarts} times"

    def _end(self, link: Transport) -> None:
        link.write(STOP)

    @classmethod
    def who_is_at(cls, port: str) -> str:
        glove = cls(port, CyberGloveConfig(port=port, raw=True))
        link = open_transport(port, place=port, baudrate=BAUDRATE)
        try:
            glove._silence(link)
            sensors, right = (glove._ask(link, query(letter))[0] for letter in "SR")
            glove._parser = Parser(sensors)
            try:
                settings = f", settings {glove._settings_now(link)}"
            except DeviceError:  # an older glove doesn't tell them
                settings = ""
        finally:
            link.close()
        return f"a {'right' if right == 1 else 'left'} glove with {sensors} sensors{settings}"

    def metrics(self) -> dict[str, object]:
        """Returns how often streaming was requested again, and how many records the glove marked as too slow."""
        return {"restarts": self._restarts, "slow_records": self._slow}

    # -- cycle

    def _take(self, data: bytes) -> Record | None:
        newest = None
        for message in self._parser.feed(data):
            if isinstance(message, Record):
                newest = message
                self._slow += message.slow
        health, parser = self.health, self._parser
        health.frames, health.errors, health.resyncs = parser.frames, parser.errors, parser.resyncs
        return newest

    def _fill(self, record: Record, now: int) -> None:
        if record.unplugged:
            self.health.message = "the glove isn't plugged into its interface"
            return
        if self._raw:
            self.state_arrays["raw"][:] = np.frombuffer(record.sensors, np.uint8)
        else:
            self._calibration.angles(record.sensors, self.state_arrays["position"])
        self.state_arrays["buttons"][0] = record.switch
        self.health.stamp = now
        self.health.message = "" if self._raw else self._calibration.note

    # -- opening

    def _load_calibration(self) -> calibration.Calibration:
        if self._calibration_file is None:
            return calibration.default(self.sensors)
        loaded = calibration.load(self._calibration_file, self.sensors)
        if loaded.hand not in (None, self.hand):
            raise self._error(
                f"{self._calibration_file.path} is of a {loaded.hand} hand, the profile says {self.hand}",
                "Name that hand's calibration, or correct 'hand'",
            )
        return loaded

    def _silence(self, link: Transport) -> None:
        """Ends a stream that an earlier client left on, and discards the bytes on their way."""
        for _ in range(TRIES):
            link.write_all(STOP, ANSWER)
            for _ in remaining(ANSWER):
                if not link.read_wait(QUIET):
                    return
        raise self._error("the device keeps sending after the command to stop", _REMEDY)

    def _identify(self, link: Transport) -> None:
        sensors = self._ask(link, query("S"))[0]
        if sensors != self.sensors:
            raise self._error(
                f"this glove has {sensors} sensors, the profile says {self.sensors}",
                f"Set 'sensors: {sensors}'" if sensors in LABELS else _REMEDY,
            )
        ready = self._ask(link, query("G"))[0]
        if ready & 3 != 3:
            missing = "isn't plugged into its interface" if not ready & 2 else "hasn't initialised itself"
            raise self._error(f"the glove {missing}", "Plug it in, switch it off and on")
        hand = "right" if self._ask(link, query("R"))[0] == 1 else "left"
        if hand != self.hand:
            raise self._error(f"this is a {hand} glove, the profile says {self.hand}", f"Set 'hand: {hand}'")

        if self._own is not None and (now := self._settings_now(link)) != self._own:
            raise self._error(
                f"the glove's own offsets and gains are other ones: 'settings' {now}, the profile says {self._own}",
                "Another program changed them, so the counts mean other angles: calibrate again, or correct 'settings'",
            )

    def _settings_now(self, link: Transport) -> str:
        """Returns a checksum of the offsets and gains that the glove keeps; eight hexadecimal digits."""
        return f"{zlib.crc32(self._ask(link, query('C'))):08x}"

    def _stream(self, link: Transport) -> None:
        """Starts the stream: all sensors, no time stamp, status byte on; an earlier client may have changed these."""
        for setting in self._settings:
            self._ask(link, setting)
        self._parser.reset(time_stamp=False, status=True)
        link.write_all(START, ANSWER)
        heard = b""
        for left in remaining(ANSWER):
            data = link.read_wait(left)
            heard = heard or data
            record = self._take(data)
            if record is not None:
                return
        raise self._error(f"the glove doesn't stream: it sent {_shown(heard)}", _REMEDY)

    def _ask(self, link: Transport, command: bytes) -> bytes:
        """Returns the value in the answer to one command."""
        expected = command[:2] if command[:1] == b"?" else command[:1]
        heard = b""
        for _ in range(TRIES):
            link.flush_input()
            self._parser.reset(time_stamp=False, status=False)
            link.write_all(command, ANSWER)
            for left in remaining(ANSWER):
                data = link.read_wait(left)
                heard += data[: 64 - len(heard)] if len(heard) < 64 else b""
                for message in self._parser.feed(data):
                    if isinstance(message, Reply) and message.command == expected:
                        return message.value
        raise self._error(f"expected a CyberGlove's answer to {command!r}, got {_shown(heard)}", _REMEDY)


def _shown(heard: bytes) -> str:
    return f"the bytes {heard[:12].hex(' ')}" if heard else "nothing"
