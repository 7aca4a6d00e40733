"""A bus of Dynamixel servos: sampled and commanded together, one exchange after another, without blocking.

In a cycle's `write` one packet carries all goals, followed by the next request for samples. A later cycle's `read`
takes the answers. Without commands `read` sends the requests itself. The answers show that the servos took the goals
in front of the request. So never more than one command is on its way (see `Line`).
"""

from __future__ import annotations

import contextlib
from operator import add
from typing import Final

import numpy as np

from srl.drivers.dynamixel import declare
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import family
from srl.drivers.dynamixel.faults import Faults, who_is_silent
from srl.drivers.dynamixel.goals import Goals
from srl.drivers.dynamixel.line import Line, Request
from srl.drivers.dynamixel.plan import Plan
from srl.drivers.dynamixel.recovery import Recovery
from srl.drivers.dynamixel.session import Session, who
from srl.drivers.dynamixel.setup import Bus, set_up, watchdog_code
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Kind, Stop

LOST: Final = 1_000_000_000  # ns without any answer from a servo
_SUSPECT: Final = 0.8  # share of the watchdog's time without a packet after which it may have tripped


class Dynamixel(Driver):
    """Axes driven by MX servos.

    States, all (n,) in the profile's order of motors: `position` (rad; m of a prismatic axis), `velocity` (rad/s,
    m/s), `effort` (N m, N: from the current; from the load on an MX-28), `temperature` (degC), `voltage` (V).
    Command: `position_command`, `velocity_command` or `effort_command`, by the profile's `mode`. A sample's stamp
    is the time of its request, so a sample is never older than its stamp. Source: protocol sheet dynamixel.
    """

    Config = DynamixelConfig
    summary = "Dynamixel MX-28/64/106 servos on one bus, protocol 1.0 or 2.0"
    usb = ("0403:6014",)  # FTDI, in the U2D2
    gives = declare.STATES
    takes: tuple[str, ...] = declare.COMMANDS
    max_age = 0.1
    calibrated = servo_record.WHAT

    def __init__(self, name: str, config: DynamixelConfig) -> None:
        super().__init__(name, config)
        self.config: DynamixelConfig = config
        self.simulated = servo_record.of_device(config.calibration, name)
        self._family = family(config)
        self.states, self.commands = (
            declare.states(config.motors),
            (declare.command(config, self._family.unit.tolist()),),
        )
        self._kind = self.commands[0].kind
        self.limits[config.command] = config.limits
        motors = config.motors
        homes = [motor.home for motor in motors.values() if motor.home is not None]
        if homes and self._kind is not Kind.TORQUE:
            self.home[config.command] = np.array(homes)
        self._faults = Faults(tuple(motors))
        self._link: Transport | None = None
        self._line: Line | None = None
        self._bus: Bus | None = None
        self._number = {id: i for i, id in enumerate(config.ids)}
        self._suspect_after = round(_SUSPECT * config.watchdog * 1e9)
        self._counted = [0, 0, 0]  # frames, errors, resyncs of earlier connections
        f = self._family
        self._arm = b""
        if f.protocol == 2:
            self._arm = f.frame("bus_watchdog", 0) + f.frame("bus_watchdog", watchdog_code(config.watchdog))
        self._limp = f.frame("torque_enable", 0)
        self._zero = b"" if self._kind is Kind.POSITION else f.again()  # the goals are still 0 here
        self._forget()

    def _forget(self) -> None:
        self._goals = Goals(self._family, self._faults, self._kind)
        self._recovery: Recovery | None = None
        self._words = b""  # a stop command that wasn't sent yet
        self._let_go = False  # LIMP was requested
        self._prefix = b""  # bytes sent in front of the next request
        self._writing = False  # `write` was called since the last `read`
        self._sampled = self._driven = False  # since opening; commanded since the last rest
        self._suspect = self._checked = False  # whether the watchdogs must be checked; whether that was just done
        self._sampling = False
        self._plan = Plan(self._family)
        self._exchanges = self._unanswered = 0
        self._hold: tuple[bytes, tuple[bytes, ...]] = b"", ()  # goals, and the stop frame made of them
        filler = self._family.filler
        self._limp_frames, self._zero_frames = (filler + self._limp * 2,), (filler + self._zero * 2,)

    def open(self) -> None:
        """Blocks about 0.1 s, some seconds if servos are missing.

        Servos without torque stay without. Servos with torque, from an earlier run, continue to hold.
        """
        self.close()
        link = open_transport(self.config.port, place=self.name, baudrate=self.config.baudrate)
        try:
            session = Session(link, self._family, self.name)
            bus = set_up(session, scan=not self.health.was_open)
        except BaseException:
            link.close()
            raise
        self._link, self._bus = link, bus
        self._line = Line(link, self._family)
        self._forget()
        self._goals.powered = list(bus.powered)
        self._faults.clear()
        for i, bits in enumerate(bus.errors):
            self._faults.hardware(i, bits, self._family.protocol)
        self._name_faults()
        self.limits = {self.config.command: bus.limits}
        self._keep(session.parser.frames, session.parser.errors, session.parser.resyncs)
        self.health.opened()
        self.health.message = f"firmware {', '.join(map(str, bus.firmware))}"

    def read(self, now: int) -> None:
        line = self._open_line()
        try:
            over = line.poll(now)
            if over is not None:
                self._take(over, now)
            self._count(line)
            self._watch(line, now)
            if not self._writing:
                self._rest()
                if line.free:
                    self._ask(line, now, False)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        self._writing = False
        self.health.unsent = line.unsent

    def write(self, now: int) -> None:
        """A servo gets torque with its first goal, which must be near its present position."""
        line = self._open_line()
        self._writing = True
        if not line.free:
            return
        try:
            self._ask(line, now, True)
        except DeviceLostError:
            self.health.connected = False
            raise

    def stop(self, category: Stop) -> None:
        """LIMP switches the torque off; goals of velocity and effort become 0."""
        if self._line is None:
            return
        if category is Stop.LIMP:
            if not self._let_go or any(self._goals.powered):
                self._words = self._limp
            self._let_go = True
            self._goals.powered = [False] * len(self._goals.powered)
        elif self._zero and not self._words:
            self._words = self._zero
        if self._words and self._line.free:
            with contextlib.suppress(DeviceError):  # the next read reports a lost link
                if self._line.link.write(self._words):
                    self._publish_words()

    def close(self) -> None:
        """Servos hold their last position; velocity and effort become 0; the watchdog is off."""
        link, line = self._link, self._line
        self._link = self._line = None
        if link is None or line is None:
            return
        if self.health.connected:
            with contextlib.suppress(DeviceError):
                if line.pending is not None or line.in_doubt:
                    link.read_wait(0.03)  # the servos finish their present answers
                rest = self._family.frame("bus_watchdog", 0) if self._family.protocol == 2 else b""
                link.write_all(self._words + self._zero + rest, 0.2)
        self.health.connected = False
        self._words = b""
        self._keep(line.parser.frames, line.parser.errors + line.timeouts, line.parser.resyncs)
        link.close()

    @classmethod
    def who_is_at(cls, port: str) -> str:
        return who(port)

    def fileno(self) -> int | None:
        return self._link.fileno() if self._link is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """LIMP switches the torque off; others repeat the last positions, or set goals to 0.

        Velocity and effort goals are those set to 0. The packet is sent twice, because the first may collide with a
        servo's answer on the bus. Filler bytes in front complete a packet that was cut short; servos refuse it for its
        checksum.
        """
        if category is Stop.LIMP:
            return self._limp_frames
        if self._zero:
            return self._zero_frames
        goals, frames = self._hold
        if goals is not self._goals.newest:
            goals = self._goals.newest
            frames = (self._family.filler + goals + goals,) if goals else ()
            self._hold = goals, frames
        return frames

    def recover(self, now: int) -> None:
        """Restarts servos with hardware errors and rearms tripped watchdogs.

        The torque stays off until the next `write` whose goal is near the servo's position.
        """
        faults, family, bus = self._faults, self._family, self._bus
        if self._line is None or bus is None or self._recovery is not None:
            return
        if faults.tripped:
            self._prefix += self._arm
            faults.tripped.clear()
        faults.far.clear()
        if family.protocol == 1:
            overloaded = {self._family.ids[i]: bus.torque[i] for i in faults.errors}
            if overloaded:
                self._prefix += family.frame("torque_enable", 0, overloaded)
                self._prefix += family.frame("torque_limit", overloaded)
            faults.clear()
        else:
            reboot = set(faults.errors) | faults.stubborn
            faults.stubborn.clear()
            if reboot or faults.limp:
                self._recovery = Recovery(family, faults, reboot, now)
        self._name_faults()

    def metrics(self) -> dict[str, object]:
        """Returns firmware versions by motor, exchanges, and requests that weren't answered in full."""
        firmware = dict(zip(self.config.motors, self._bus.firmware, strict=True)) if self._bus else {}
        return {"firmware": firmware, "exchanges": self._exchanges, "unanswered": self._unanswered}

    # -- an exchange

    def _ask(self, line: Line, now: int, commanding: bool) -> None:
        """Sends pending commands, followed by the next request."""
        request, alone = self._next(line, now)
        if request is None:
            return
        goals, waking = self._give() if commanding and not alone else (b"", [])
        if commanding:
            self._words = b""
        if line.send(request, now, self._prefix + self._words + goals):
            self._prefix = b""
            self._publish_words()
            self._exchanges += 1
            if goals:
                name = self.config.command
                self._goals.left(goals, waking, self.command_arrays[name], self.sent_arrays[name])
                self._driven = True
                self._let_go = False

    def _give(self) -> tuple[bytes, list[int]]:
        """See `Goals.packets`; nothing while the servos refuse goals, or their positions aren't known yet."""
        faults = self._faults
        if faults.tripped or not self._sampled:
            return b"", []
        before = len(faults.far)
        found = self._goals.packets(
            self.command_arrays[self.config.command], self.state_arrays["position"], self._away()
        )
        if len(faults.far) > before:
            self._name_faults()
        return found

    def _publish_words(self) -> None:
        """Notes that the stop command has left; it may set goals of velocity and effort to 0."""
        if self._words and self._words == self._zero and self._goals.newest:
            self.sent_arrays[self.config.command][:] = 0.0
        self._words = b""

    def _rest(self) -> None:
        """Handles the end of commands, e.g. after a fault: velocity and effort goals must not stay in force."""
        if self._driven and self._zero:
            self._words = self._words or self._zero
        self._driven = False

    def _next(self, line: Line, now: int) -> tuple[Request | None, bool]:
        """Returns the next request, and whether it must be sent without goals."""
        late = line.sent < 0 or now - line.sent > self._suspect_after
        if self._arm and (self._suspect or late) and not self._checked:
            self._suspect, self._checked = False, True
            return self._plan.request("watchdog", self._away()), True
        self._checked = False
        if self._recovery is not None and not self._sampling:
            self._sampling = True
            goes_on, request = self._recovery.step(now)
            if not goes_on:
                self._recovery = None
                self._name_faults()
            elif request is not None:
                return request, True
        self._sampling = False
        return self._plan.next(now, self._away()), False

    def _away(self) -> set[int]:
        return self._recovery.away if self._recovery is not None else set()

    def _take(self, request: Request, now: int) -> None:
        answers = request.answers
        self._unanswered += not request.complete
        if self._prefix:
            pass  # requested before the present recovery: tells nothing about faults that are still there
        elif self._family.protocol == 1:
            for id, status in answers.items():
                self._error_bits(self._number[id], status.error)
        elif any(status.alert and self._number[id] not in self._faults.errors for id, status in answers.items()):
            self._plan.check_soon()  # the register tells which fault it is
        if request.purpose in ("sample", "extra"):
            self._fill(request)
        elif request.purpose == "check" and not self._prefix:
            self._check(request)
        elif request.purpose == "watchdog":
            self._take_watchdogs(request)

    def _fill(self, request: Request) -> None:
        answers, ids = request.answers, self._family.ids
        if len(answers) < len(ids):
            return  # a sample has values of all motors at one time; otherwise there is none
        data = b"".join([answers[id].data for id in ids])
        if len(data) != request.size * len(ids):
            return  # one motor reported an error instead of its data
        self._family.decode(data, request.size, self.state_arrays)
        self.health.stamp = request.sent
        self._sampled = True

    def _check(self, request: Request) -> None:
        """Takes each motor's torque enable, and its hardware error status or torque limit."""
        address, size = self._family.check
        for id, status in request.answers.items():
            i = self._number[id]
            if len(status.data) != size:
                continue
            registers = self._family.tables[i]
            if self._family.protocol == 2:
                self._error_bits(i, registers["hardware_error_status"].decode(status.data, address))
            elif not registers["torque_limit"].decode(status.data, address) and i not in self._faults.errors:
                self._faults.errors[i] = "its torque limit is 0, as after an overload"
            if not registers["torque_enable"].decode(status.data, address):
                if self._goals.powered[i] and i not in self._faults.errors:
                    self._faults.limp.add(i)
                self._goals.powered[i] = False
        self._name_faults()

    def _error_bits(self, i: int, bits: int) -> None:
        if bits and i not in self._faults.errors:
            self._faults.hardware(i, bits, self._family.protocol)
            if i in self._faults.errors:
                self._goals.powered[i] = False
                self._name_faults()

    def _take_watchdogs(self, request: Request) -> None:
        tripped = {self._number[id] for id, status in request.answers.items() if status.data == b"\xff"}
        unarmed = any(status.data == b"\0" for status in request.answers.values())
        if not request.complete:
            self._suspect = True
        elif tripped and self._goals.newest and any(self._goals.powered):
            self._faults.tripped |= tripped  # a motion was interrupted: continuing needs a user's reset
            self._name_faults()
        elif tripped or unarmed:
            self._prefix = self._arm

    def _watch(self, line: Line, now: int) -> None:
        """Raises DeviceLostError if a servo hasn't answered for a second."""
        if silent := line.silent(now - LOST) - self._away():
            remedy = "Check the bus' cables and the servos' power"
            raise DeviceLostError(self.name, who_is_silent(self.config.motors, silent), remedy)

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
            raise DeviceLostError(self.name, "the bus isn't open", "Open it first")
        return self._line
