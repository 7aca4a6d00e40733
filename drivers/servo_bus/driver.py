"""A bus of serial servos: sampled and commanded together, one exchange after another, without blocking.

In a cycle's `write` one packet carries all goals, followed by the next request for samples. A later cycle's `read`
takes the answers. Without commands `read` sends the requests itself. The answers show that the servos took the goals
in front of the request. So never more than one command is on its way (see `Line`).
"""

from __future__ import annotations

import contextlib
from abc import abstractmethod
from operator import add
from typing import Any, Final

import numpy as np

from srl.drivers.linked import Linked
from srl.drivers.servo_bus import declare
from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.config import ServoBusConfig, bounds
from srl.drivers.servo_bus.faults import Faults, who_is_silent
from srl.drivers.servo_bus.goals import Goals
from srl.drivers.servo_bus.line import Line, Request
from srl.drivers.servo_bus.plan import Plan
from srl.drivers.servo_bus.units import Units
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Command, Kind

LOST: Final = 1_000_000_000  # ns without any answer from a servo


class ServoBus(Linked[Transport]):
    """What the drivers of both makers do: reading, writing, closing. A maker's adds what is asked, and what it means.

    States, all (n,) in the profile's order of motors: `position` (rad; m of a prismatic axis), `velocity` (rad/s,
    m/s), `effort` (N m, N), `temperature` (degC), `voltage` (V). A sample's stamp is the time of its request, so a
    sample is never older than its stamp.
    """

    gives = declare.STATES
    max_age = 0.1
    calibrated = servo_record.WHAT
    config: ServoBusConfig
    _bus: Any
    _goals: Goals
    _plan: Plan

    def __init__(self, name: str, config: ServoBusConfig, units: Units, faults: Faults, command: Command) -> None:
        """`command`: the one that the bus takes."""
        super().__init__(name, config)
        self.config, self._place = config, name
        self.simulated = servo_record.of_device(config.calibration, name)
        self._units, self._faults = units, faults
        self.states, self.commands = declare.states(config.motors), (command,)
        homes = [motor.home for motor in config.motors.values() if motor.home is not None]
        if homes and command.kind is not Kind.TORQUE:
            self.home[command.name] = np.array(homes)
        self.limits[command.name] = bounds(config.motors)  # the servos' own are known once they answer
        self._line: Line | None = None
        self._bus = None
        self._number = {id: i for i, id in enumerate(config.ids)}
        self._counted = [0, 0, 0]  # frames, errors, resyncs of earlier connections
        self._limp = units.frame("torque_enable", 0)

    def _forget(self) -> None:
        """What is true of a new connection."""
        self._plan = Plan(self._units)
        self._stop_packet = b""  # a stop command that wasn't sent yet
        self._let_go = False  # LIMP was requested, and no goal since
        self._prefix = b""  # bytes sent in front of the next request
        self._writing = False  # `write` was called since the last `read`
        self._sampled = False  # since opening
        self._exchanges = self._unanswered = 0

    def connect(self) -> Transport:
        return open_transport(self.config.port, place=self.name, baudrate=self.config.baudrate)

    def _set_up(self, link: Transport) -> None:
        """Blocks about 0.1 s, some seconds if servos are missing.

        Servos without torque stay without. Servos with torque, from an earlier run, continue to hold.
        """
        asker = self._asker(link)
        bus = self._bus = self._identify(asker, scan=not self.health.was_open)
        self._line = Line(link, self._units)
        self._forget()
        self._goals.powered = list(bus.powered)
        self._faults.clear()
        self._found(bus)
        self._name_faults()
        self.limits = {self.commands[0].name: bus.limits}
        self._keep(asker.parser.frames, asker.parser.errors, asker.parser.resyncs)

    def _receive(self, link: Transport, now: int) -> None:
        line = self._open_line()
        over = line.poll(now)
        if over is not None:
            self._take(over, now)
        self._count(line)
        if silent := line.silent(now - LOST) - self._away():
            raise self._lost(who_is_silent(self.config.motors, silent), "Check the bus' cables and the servos' power")
        if not self._writing:
            self._idle()
            if line.free:
                self._ask(line, now, False)
        self._writing = False
        self.health.unsent = line.unsent

    def write(self, now: int) -> None:
        """A servo gets torque with, or after, a first goal near its present position."""
        line = self._open_line()
        self._writing = True
        if not line.free:
            return
        try:
            self._ask(line, now, True)
        except DeviceLostError:
            self.health.connected = False
            raise

    def close(self) -> None:
        """Servos with torque hold their last goals, also without a host."""
        super().close()
        line, self._line = self._line, None
        if line is not None:
            self._stop_packet = b""
            self._keep(line.parser.frames, line.parser.errors + line.timeouts, line.parser.resyncs)

    def _end(self, link: Transport) -> None:
        line = self._line
        if self.health.connected and line is not None:
            if line.pending is not None or line.resyncing:
                link.read_wait(0.03)  # the servos finish their present answers
            if last := self._last():
                link.write_all(last, 0.2)

    def fileno(self) -> int | None:
        return self._link.fileno() if self._link is not None else None

    def metrics(self) -> dict[str, object]:
        """Returns firmware versions by motor, exchanges, and requests that weren't answered in full."""
        firmware = dict(zip(self.config.motors, self._bus.firmware, strict=True)) if self._bus else {}
        return {"firmware": firmware, "exchanges": self._exchanges, "unanswered": self._unanswered}

    def _asker(self, link: Transport) -> Any:
        """The questions that are asked while the bus is opened."""
        return Asker(link, self._units, self.name)

    @abstractmethod
    def _identify(self, asker: Any, scan: bool) -> Any:
        """Identifies, checks and configures all motors; returns what was found.

        `scan`: if no motor answers, look for them at other baud rates. Raises DeviceError.
        """

    @abstractmethod
    def _found(self, bus: Any) -> None:
        """Takes what was found: the servos' errors, and what it says of them."""

    @abstractmethod
    def _ask(self, line: Line, now: int, commanding: bool) -> None:
        """Sends pending commands, followed by the next request."""

    @abstractmethod
    def _take(self, request: Request, now: int) -> None:
        """Takes a request that has ended, answered or not."""

    def _idle(self) -> None:
        """Handles a cycle without a command."""

    def _away(self) -> set[int]:
        """Ids of servos that can't answer now."""
        return set()

    def _last(self) -> bytes:
        """What is sent before the link is closed."""
        return self._stop_packet

    def _release(self) -> None:
        """Has the torque switched off with the next packet."""
        if not self._let_go or any(self._goals.powered):
            self._stop_packet = self._limp
        self._let_go = True
        self._goals.powered = [False] * len(self._goals.powered)

    def _send_stop(self) -> bool:
        """Sends the pending stop command at once where the line is free. Returns whether it left."""
        if self._stop_packet and self._line is not None and self._line.free:
            with contextlib.suppress(DeviceError):  # the next read reports a lost link
                return self._line.link.write(self._stop_packet)
        return False

    def _name_faults(self) -> None:
        self.health.fault = self._faults.text()

    def _count(self, line: Line) -> None:
        parser, health = line.parser, self.health
        new = parser.frames, parser.errors + line.timeouts, parser.resyncs
        health.frames, health.errors, health.resyncs = map(add, self._counted, new)

    def _keep(self, *counts: int) -> None:
        self._counted = list(map(add, self._counted, counts))

    def _open_line(self) -> Line:
        if self._line is None:
            raise self._not_open()
        return self._line
