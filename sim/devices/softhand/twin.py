"""The twin of a SoftHand: the qbrobotics protocol on a serial line."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.drivers.softhand import protocol
from srl.drivers.softhand.protocol import Cmd, Frame, Parser
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.softhand.fake import FakeSoftHand

SERIAL = 20_26_01
_ACK, _REFUSED = b"\x01\x01", b"\x00\x00"
_TEXT = "qbrobotics SoftHand\nID: {id}\nPosition limits: inf -> {low} sup -> {high}\n"


class SoftHandTwin(SerialTwin):
    """Answers frames for its id with a correct checksum; activation and references get no answer.

    Only references and activation reset its watchdog; this is the stricter reading of the sheet.

    Attributes:
        echo: the adapter sends each byte back, as some RS485 adapters do.
        deaf: it obeys no unacknowledged frame, as if every such frame were lost.
        parameters: whether it answers PARAMETERS; older firmware doesn't.
        control: the control mode that it tells; 0: position.
    """

    def __init__(self, fake: FakeSoftHand) -> None:
        super().__init__(fake)
        self.hand = fake
        self.id = fake.config.id
        self.echo = self.deaf = False
        self.parameters = True
        self.control = 0
        self.serial_number = SERIAL
        self._parser = Parser()
        self._watchdog = 0  # ns; 0: off
        self._fed = 0
        self._inputs = (0, 0)
        self._seen: dict[str, int] = {}
        self._trips = 0
        self._references: list[tuple[int, int]] = []
        self._answers: dict[int, Callable[[Frame], bytes]] = {
            Cmd.PING: lambda _: self._reply(Cmd.PING, self.serial_number.to_bytes(4, "big")),
            Cmd.GET_INFO: self._info,
            Cmd.STORE: lambda _: self._reply(Cmd.STORE, _ACK),
            Cmd.PARAMETERS: self._parameters,
            Cmd.GET_ACTIVATE: lambda _: self._reply(Cmd.GET_ACTIVATE, b"\x03" if self.hand.active else b"\x00"),
            Cmd.GET_INPUTS: lambda _: self._numbers(Cmd.GET_INPUTS, *self._inputs),
            Cmd.GET_MEASUREMENTS: lambda _: self._numbers(Cmd.GET_MEASUREMENTS, self._ticks, 0, 0),
            Cmd.GET_CURRENTS: lambda _: self._numbers(Cmd.GET_CURRENTS, self._milliamperes, 0),
            Cmd.GET_BOTH: lambda _: self._numbers(Cmd.GET_BOTH, self._milliamperes, 0, self._ticks, 0, 0),
            Cmd.GET_VELOCITIES: lambda _: self._numbers(Cmd.GET_VELOCITIES, 0, 0, 0),
            Cmd.SET_WATCHDOG: self._set_watchdog,
            Cmd.SET_BAUDRATE: lambda found: self._reply(
                Cmd.SET_BAUDRATE, _ACK if found.data in (b"\x03", b"\x0d") else _REFUSED
            ),
        }

    def open(self) -> None:
        """The state is that after a loss of power."""
        super().open()
        self.power_up()

    def power_up(self) -> None:
        """Switches the motor and the watchdog off."""
        self.hand.activate(False)
        self._watchdog = 0
        self._parser.reset()

    def receive(self, data: bytes, now: int) -> bytes:
        answers = [data] if self.echo else []
        for found in self._parser.feed(data):
            if found.id in (self.id, 0):
                answer = self._obey(found, now)
                if found.id:
                    answers.append(answer)
        return b"".join(answers)

    def work(self, now: int) -> bytes:
        if self._watchdog and self.hand.active and now - self._fed > self._watchdog:
            self.hand.activate(False)
            self._trips += 1
        return b""

    def metrics(self) -> dict[str, object]:
        """Adds to the serial twin's figures: commands by name, discarded frames, watchdog trips, the motor's state."""
        return super().metrics() | {
            "commands": dict(self._seen),
            "errors": self._parser.errors,
            "watchdog_trips": self._trips,
            "watchdog_ms": self._watchdog // 1_000_000,
            "active": self.hand.active,
            "reference": self._inputs[0],
        }

    def log(self) -> dict[str, NDArray[Any]]:
        """Adds to the serial twin's log: `reference_ns` (k,), when each reference came; `reference` (k,), its ticks."""
        at, ticks = np.array(self._references, np.int64).reshape(-1, 2).T
        return super().log() | {"reference_ns": at, "reference": ticks}

    # -- the firmware

    def _obey(self, found: Frame, now: int) -> bytes:
        known = found.command in Cmd.__members__.values()
        name = Cmd(found.command).name if known else f"unknown {found.command}"
        self._seen[name] = self._seen.get(name, 0) + 1
        if found.command == Cmd.ACTIVATE and len(found.data) == 1:
            if not self.deaf:
                self._fed = now
                self.hand.activate(bool(found.data[0] & 1))
                self._inputs = (self._ticks, 0)
        elif found.command == Cmd.SET_INPUTS and len(found.data) == 4:
            if not self.deaf:
                self._fed = now
                self._inputs = struct.unpack(">hh", found.data)
                self.hand.refer(self._inputs[0])
                if self.keep_log:
                    self._references.append((now, self._inputs[0]))
        elif found.command in self._answers:
            return self._answers[found.command](found)
        return b""

    def _set_watchdog(self, found: Frame) -> bytes:
        if len(found.data) != 1:
            return self._reply(Cmd.SET_WATCHDOG, _REFUSED)
        self._watchdog = found.data[0] * 2_000_000
        return self._reply(Cmd.SET_WATCHDOG, _ACK)

    def _info(self, found: Frame) -> bytes:
        hand = self.hand
        return _TEXT.format(id=self.id, low=hand.open_ticks, high=hand.closed_ticks).encode("ascii")

    def _parameters(self, found: Frame) -> bytes:
        if not self.parameters or found.data[:2] not in (b"", b"\0\0"):
            return b""
        limits = protocol.Limits(self.hand.open_ticks, self.hand.closed_ticks)
        return protocol.parameters(self.id, limits, self.control)

    @property
    def _ticks(self) -> int:
        return self.hand.newest_measurement()[0]

    @property
    def _milliamperes(self) -> int:
        return self.hand.newest_measurement()[1]

    def _reply(self, command: int, data: bytes) -> bytes:
        return protocol.frame(self.id, command, data)

    def _numbers(self, command: int, *values: int) -> bytes:
        clipped = [max(-32768, min(32767, value)) for value in values]
        return self._reply(command, struct.pack(f">{len(clipped)}h", *clipped))
