"""A ring with one button: a Bluetooth remote behind Linux's input devices, or a self-made one on a serial port."""

from __future__ import annotations

import contextlib
import os
import re
import stat
import time
from pathlib import Path
from typing import Final

from pydantic import Field, field_validator

from srl.drivers.debounce import Debounced
from srl.drivers.devicetime import DeviceTime
from srl.drivers.evdev import EventSource, discover, open_source
from srl.drivers.evdev.records import EV_KEY
from srl.drivers.evdev.source import NODES
from srl.drivers.ring.serial_ring import ASK, BAUDRATE, Parser
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.driver import DeviceConfig, Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Signal

KEYS: Final = (115, 28)  # KEY_VOLUMEUP, KEY_ENTER: the keys that shutter remotes send
LOOK: Final = 1_000_000_000  # ns between searches for a ring that sleeps
_ANSWER: Final = 1.0  # s


class RingConfig(DeviceConfig):
    """Options of a ring."""

    port: str = Field(
        "input", description="'input': a Bluetooth remote by `match`; a serial port; an input node's path"
    )
    match: str = Field("AB Shutter3", description="regular expression on the remote's name, or its address")
    keys: tuple[int, ...] = Field(KEYS, min_length=1, description="key codes that mean pressed")
    debounce: float = Field(0.025, ge=0, le=0.5, description="s a level must last")
    hold: bool = Field(True, description="false for a remote that sends press and release together: each is a press")

    @field_validator("match")
    @classmethod
    def _is_expression(cls, text: str) -> str:
        try:
            re.compile(text)
        except re.error as error:
            raise ValueError(f"isn't a regular expression: {error}") from None
        return text


class Ring(Sensor):
    """A ring with one push button.

    States: `buttons` (1,), 1 while pressed; `presses` (1,), number of presses since the start.

    An unused Bluetooth remote goes to sleep: its nodes vanish. This doesn't count as a loss: the button reads released,
    the message reports it, and the driver opens the ring again when it is back (it looks once a second). So such a ring
    may toggle something, but it can be neither an emergency stop nor a hold-to-run button. The serial ring can: it has
    a heartbeat, and without one for `max_age` it is stale.
    """

    Config = RingConfig
    summary = "ring with one push button (Bluetooth remote, or serial with heartbeat)"
    gives = ("buttons", "presses")
    among_inputs = ("input",)
    max_age = 0.3

    def __init__(self, name: str, config: RingConfig) -> None:
        super().__init__(name, config)
        self.states = (
            Signal(name="buttons", shape=(1,), unit="1", labels=("button",)),
            Signal(name="presses", shape=(1,), unit="1", labels=("button",)),
        )
        self._config = config
        self._switch = Debounced(config.debounce)
        self._presses = 0  # presses of a remote that can't be held
        self._sources: list[EventSource] = []
        self._down: set[tuple[int, int]] = set()  # (source, key)
        self._nodes: frozenset[str] = frozenset()  # nodes already examined
        self._listed: frozenset[str] = frozenset()  # nodes that existed at the last look
        self._look_at = 0
        self._link: Transport | None = None
        self._parser = Parser()
        self._clock = DeviceTime(1_000_000, bits=32)

    def open(self) -> None:
        self.close()
        if self._is_input():
            self._sources = self._wake()
            if not self._sources:
                raise DeviceError(self.name, *self._nothing())
            try:
                for source in self._sources:
                    source.await_description(_ANSWER)
            except DeviceError:
                self.close()
                raise
            self.health.message = "awake"
        else:
            self._open_serial()
        self._switch.start(0.0)
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected:
            raise DeviceLostError(self.name, "it isn't open", "Open it first")
        if self._link is not None:
            self._read_serial(now)
        else:
            self._read_input(now)
        self._switch.settle(now)
        self.state_arrays["buttons"][0] = self._switch.pressed
        self.state_arrays["presses"][0] = self._switch.presses + self._presses

    def close(self) -> None:
        sources, self._sources = self._sources, []
        link, self._link = self._link, None
        self._down.clear()
        self.health.connected = False
        for source in sources:
            source.close()
        if link is not None:
            link.close()

    # -- Bluetooth remote

    def _is_input(self) -> bool:
        port = self._config.port
        if port == "input" or port.startswith(str(NODES)):
            return True
        try:
            return stat.S_ISSOCK(os.stat(port).st_mode)
        except OSError:
            return False

    def _read_input(self, now: int) -> None:
        for number, source in enumerate(self._sources):
            try:
                reports = source.read()
            except DeviceLostError:
                self._sleep(now)
                break
            for report in reports:
                self.health.frames += 1
                for at, kind, code, value in report:
                    if kind == EV_KEY and code in self._config.keys:
                        self._key(number, code, value, min(at, now))
        if not self._sources and now >= self._look_at:
            self._look(now)
        self.health.stamp = now

    def _key(self, source: int, code: int, value: int, at: int) -> None:
        """Takes a key event; value 2 means still pressed."""
        was = bool(self._down)
        self._down.add((source, code)) if value else self._down.discard((source, code))
        if not self._config.hold:
            self._presses += value == 1
        elif bool(self._down) != was:
            self._switch.take(float(not was), at)

    def _sleep(self, now: int) -> None:
        for source in self._sources:
            source.close()
        self._sources = []
        self._down.clear()
        self._switch.start(0.0)
        self._nodes = self._listed = self._there()
        self._look_at = now + LOOK
        self.health.message = "asleep: its first press wakes it"

    def _look(self, now: int) -> None:
        """Tries to open the ring if there is a new node: opening nodes costs the loop more than listing a folder.

        Each new node is tried twice, because udev grants access to a node some time after it appears.
        """
        self._look_at = now + LOOK
        there = self._there()
        if there - self._nodes:
            with contextlib.suppress(DeviceError):
                self._sources = self._wake()
        self._nodes, self._listed = self._listed & there, there
        if self._sources:
            self.health.reconnects += 1
            self.health.message = "awake"

    def _there(self) -> frozenset[str]:
        if self._config.port == "input":
            with contextlib.suppress(OSError):
                return frozenset(os.listdir(NODES))
            return frozenset()
        return frozenset([self._config.port]) if Path(self._config.port).exists() else frozenset()

    def _wake(self) -> list[EventSource]:
        """Opens all nodes of the remote: some remotes have one for the keyboard and one for media keys."""
        if self._config.port != "input":
            return [open_source(self._config.port, f"{self.name} ({self._config.port})", grab=True)]
        pattern = re.compile(self._config.match)
        found: list[EventSource] = []
        for path in discover():
            try:
                source = open_source(path, self.name)
            except DeviceError:
                continue
            described = source.description
            source.close()
            if described is not None and (
                pattern.search(described.name) or described.uniq.lower() == self._config.match.lower()
            ):
                try:
                    found.append(open_source(path, f"{self.name} ({path})", grab=True))
                except DeviceError:
                    for other in found:  # otherwise they would stay grabbed without a user
                        other.close()
                    raise
        return found

    def _nothing(self) -> tuple[str, str]:
        names = []
        for path in discover():
            try:
                source = open_source(path, self.name)
            except DeviceError as error:
                names.append(f"{path} ({error.problem})")
                continue
            names.append(source.description.name if source.description else path)
            source.close()
        return (
            f"no input device is called '{self._config.match}'; found: {', '.join(names) or 'none'}",
            "Press the ring's button to wake it; pair it once with bluetoothctl (pair, trust, connect)",
        )

    # -- serial ring

    def _open_serial(self) -> None:
        place = f"{self.name} ({self._config.port})"
        link = open_transport(self._config.port, place=place, baudrate=BAUDRATE)
        self._parser, heard = Parser(), b""
        try:
            deadline = time.monotonic() + _ANSWER
            link.write_all(ASK, _ANSWER)
            while (left := deadline - time.monotonic()) > 0:
                data = link.read_wait(left)
                heard += data[: 64 - min(len(heard), 64)]
                if any(line.kind == b"V" for line in self._parser.feed(data)):
                    break
            else:
                shown = f"the bytes {heard[:12].hex(' ')}" if heard else "nothing"
                raise DeviceError(place, f"expected the ring's name, 'V ring1 1', got {shown}", "Check port and power")
        except DeviceError:
            link.close()
            raise
        self._link = link
        self._clock.restart()
        self.health.message = ""

    def _read_serial(self, now: int) -> None:
        assert self._link is not None
        try:
            data = self._link.read()
        except DeviceLostError as error:
            self._switch.start(0.0)
            self.state_arrays["buttons"][0] = 0.0
            self.health.lost(error.problem)
            raise
        errors, frames = self._parser.errors, self._parser.frames
        for line in self._parser.feed(data):
            if line.kind == b"V":
                self._clock.restart()  # the ring also sends it after a reset
                continue
            self._switch.take(line.level, now)
            if line.clock >= 0:
                self.health.stamp = self._clock.stamp(line.clock, now)
        self.health.errors += self._parser.errors - errors
        self.health.frames += self._parser.frames - frames
