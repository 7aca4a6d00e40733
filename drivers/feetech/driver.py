"""A bus of Feetech servos: sampled and commanded together, one exchange after another, without blocking.

In a cycle's `write` one packet carries all goals, followed by the next request for samples. A later cycle's `read`
takes the answers (see `Line`). The servos have no watchdog: without a word they hold their last goal for ever.
"""

from __future__ import annotations

import contextlib
from operator import add
from typing import Final

import numpy as np

from srl.drivers.dynamixel import declare
from srl.drivers.dynamixel.asking import Asker
from srl.drivers.dynamixel.config import bounds
from srl.drivers.dynamixel.faults import who_is_silent
from srl.drivers.dynamixel.line import Line, Request
from srl.drivers.dynamixel.plan import Plan
from srl.drivers.feetech import protocol
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.faults import FeetechFaults, Watch
from srl.drivers.feetech.goals import StoredGoals
from srl.drivers.feetech.opening import Bus, set_up, settings, who
from srl.drivers.feetech.table import TABLE
from srl.drivers.feetech.units import FeetechUnits
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop

LOST: Final = 1_000_000_000  # ns without any answer from a servo
_COMMAND: Final = "position_command"


class Feetech(Driver):
    """Axes driven by STS servos.

    States, all (n,) in the profile's order of motors: `position` (rad; m of a prismatic axis), `velocity` (rad/s,
    m/s), `effort` (N m, N: from the current), `temperature` (degC), `voltage` (V). Command: `position_command`. A
    sample's stamp is the time of its request. Source: protocol sheet can_actuators, section 5.
    """

    Config = FeetechConfig
    summary = "Feetech STS bus servos (STS3215 of the SO-100/101, STS3250)"
    usb = ("1a86:55d3",)  # CH343, in the adapters that come with the SO-101
    gives = declare.STATES
    takes: tuple[str, ...] = (_COMMAND,)
    max_age = 0.1
    calibrated = servo_record.WHAT

    def __init__(self, name: str, config: FeetechConfig) -> None:
        super().__init__(name, config)
        self.config: FeetechConfig = config
        self.simulated = servo_record.of_device(config.calibration, name)
        self._units = FeetechUnits(config)
        self.states = declare.states(config.motors)
        self.commands = (declare.command_of(config.motors, _COMMAND, self._units.unit.tolist(), None),)
        homes = [motor.home for motor in config.motors.values() if motor.home is not None]
        if homes:
            self.home[_COMMAND] = np.array(homes)
        self.limits[_COMMAND] = bounds(config.motors)  # the servos' own are known once they answer
        self._faults = FeetechFaults(tuple(config.motors))
        self._link: Transport | None = None
        self._line: Line | None = None
        self._bus: Bus | None = None
        self._number = {id: i for i, id in enumerate(config.ids)}
        self._counted = [0, 0, 0]  # frames, errors, resyncs of earlier connections
        self._limp = self._units.frame("torque_enable", 0)
        self._forget()

    def _forget(self) -> None:
        self._goals = StoredGoals(self._units, self._faults)
        self._plan = Plan(self._units)
        self._words = b""  # a stop command that wasn't sent yet
        self._let_go = False  # LIMP was requested, and no goal since
        self._prefix = b""  # bytes sent in front of the next request
        self._writing = False  # `write` was called since the last `read`
        self._sampled = False  # since opening
        self._unsure = False  # a servo was silent: it may have lost its power, so it is looked at before it gets a goal
        self._exchanges = self._unanswered = 0
        self._frames: tuple[bytes | None, tuple[bytes, ...], tuple[bytes, ...]] = None, (), ()  # goals; hold; LIMP

    def open(self) -> None:
        """Blocks about 0.1 s, some seconds if servos are missing.

        Servos without torque stay without. Servos with torque, from an earlier run, continue to hold.
        """
        self.close()
        link = open_transport(self.config.port, place=self.name, baudrate=self.config.baudrate)
        try:
            asker = Asker(link, self._units, self.name)
            bus = set_up(asker, self._units, scan=not self.health.was_open)
        except BaseException:
            link.close()
            raise
        self._link, self._bus = link, bus
        self._line = Line(link, self._units)
        self._units.seen = None
        self._forget()
        self._watch = Watch(tuple(self.config.motors), bus.hottest, bus.voltages)
        self._goals.powered = list(bus.powered)
        self._faults.clear()
        for i, bits in enumerate(bus.errors):
            self._faults.bits(i, bits)
        self._name_faults()
        self.limits = {_COMMAND: bus.limits}
        self._keep(asker.parser.frames, asker.parser.errors, asker.parser.resyncs)
        self.health.opened()
        self._message = f"firmware {', '.join(sorted(set(bus.firmware)))}"
        if len(set(bus.firmware)) > 1:
            self._message += " (mixed: some versions answer a sync read differently; update the older ones)"
        self.health.message = self._message

    def read(self, now: int) -> None:
        line = self._open_line()
        try:
            over = line.poll(now)
            if over is not None:
                self._take(over, now)
            self._count(line)
            if silent := line.silent(now - LOST):
                remedy = "Check the bus' cables and the servos' power"
                raise DeviceLostError(self.name, who_is_silent(self.config.motors, silent), remedy)
            if not self._writing and line.free:
                self._ask(line, now, False)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        self._writing = False
        self.health.unsent = line.unsent

    def write(self, now: int) -> None:
        """A servo gets torque once it has stored a goal near its present position."""
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
        """LIMP switches the torque off; after any other the servos hold their last goals."""
        if self._line is None or category is not Stop.LIMP:
            return
        if not self._let_go or any(self._goals.powered):
            self._words = self._limp
        self._let_go = True
        self._goals.powered = [False] * len(self._goals.powered)
        if self._words and self._line.free:
            with contextlib.suppress(DeviceError):  # the next read reports a lost link
                if self._line.link.write(self._words):
                    self._words = b""

    def close(self) -> None:
        """Servos with torque hold their last goals, also without a host."""
        link, line = self._link, self._line
        self._link = self._line = None
        if link is None or line is None:
            return
        if self.health.connected and self._words:
            with contextlib.suppress(DeviceError):
                if line.pending is not None or line.in_doubt:
                    link.read_wait(0.03)  # the servos finish their present answers
                link.write_all(self._words, 0.2)
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
        """LIMP switches the torque off; others repeat the last goals.

        The packet is there twice, because the first may collide with a servo's answer. The filler in front completes a
        packet that was cut short, so that the servos refuse it.
        """
        goals, hold, limp = self._frames
        if goals is not self._goals.held:
            goals = self._goals.held
            filler = protocol.filler(self.config.ids, goals)
            hold, limp = (filler + goals * 2,) if goals else (), (filler + self._limp * 2,)
            self._frames = goals, hold, limp
        return limp if category is Stop.LIMP else hold

    def recover(self, now: int) -> None:
        """Switches the torque of the servos concerned off, which ends an overload.

        They are limp from then on. Each gets its torque back with the next goals, once it was looked at again.
        """
        if self._line is None:
            return
        faults, units = self._faults, self._units
        concerned = set(faults.errors) | set(faults.turned) | faults.limp
        if concerned:
            ids = [units.ids[i] for i in sorted(concerned)]
            self._prefix += units.frame("torque_enable", 0, ids)
            for key, value in settings(units).items():  # a servo whose power dipped has forgotten them
                self._prefix += units.frame(key, value, ids)
        self._goals.drop(sorted(concerned))
        faults.clear()
        self._watch.forget()
        self._unsure = True
        self._name_faults()

    def metrics(self) -> dict[str, object]:
        """Returns firmware versions by motor, exchanges, and requests that weren't answered in full."""
        firmware = dict(zip(self.config.motors, self._bus.firmware, strict=True)) if self._bus else {}
        return {"firmware": firmware, "exchanges": self._exchanges, "unanswered": self._unanswered}

    # -- an exchange

    def _ask(self, line: Line, now: int, commanding: bool) -> None:
        """Sends pending commands, followed by the next request."""
        look = self._unsure or (commanding and self._goals.waiting)
        request = self._plan.request("check", set()) if look else self._plan.next(now, set())
        assert request is not None  # there is always a servo
        goals, waking = b"", list[int]()
        if commanding and self._sampled and not self._unsure:
            before = len(self._faults.far)
            command, position = self.command_arrays[_COMMAND], self.state_arrays["position"]
            goals, waking = self._goals.packets(command, position, set())
            if len(self._faults.far) > before:
                self._name_faults()
        if goals:
            self._words = b""
        if line.send(request, now, self._prefix + self._words + goals):
            self._prefix = self._words = b""
            self._exchanges += 1
            if goals:
                self._goals.left(goals, waking, self.command_arrays[_COMMAND], self.sent_arrays[_COMMAND])
                self._let_go = False

    def _take(self, request: Request, now: int) -> None:
        self._unanswered += not request.complete
        self._unsure = self._unsure or not request.complete
        if not self._prefix:  # else it was requested before the present recovery, and tells nothing about what is left
            for id, status in request.answers.items():
                self._faults.bits(self._number[id], status.error)
        if request.complete:
            data = [request.answers[id].data for id in self._units.ids]
            if all(len(part) == request.size for part in data):
                self._fill(request, data, now)
        self._name_faults()

    def _fill(self, request: Request, data: list[bytes], now: int) -> None:
        """Takes a sample of all motors, and with a check their torque and stored goals."""
        units, faults = self._units, self._faults
        skip = units.sample[0] - units.check[0] if request.purpose == "check" else 0
        sample = b"".join([part[skip:] for part in data])
        turned = units.turned(sample)
        for i in map(int, np.flatnonzero(turned)):
            self._turned(i, int(turned[i]), sample)
        units.decode(sample, units.sample[1], self.state_arrays)
        self.health.stamp = request.sent
        self._sampled = True
        warning = self._watch.judge(
            self.state_arrays["temperature"], self.state_arrays["voltage"], request.sent, faults
        )
        self.health.message = f"{self._message}; {warning}" if warning else self._message
        if request.purpose == "check":
            for i, part in enumerate(data):
                self._check(i, part)
            self._unsure = False

    def _turned(self, i: int, turns: int, sample: bytes) -> None:
        """A position jumped by whole turns: the servo would drive them all back, so it loses its torque first."""
        units = self._units
        counts = TABLE["present_position"].decode(sample, TABLE["present_position"].address - i * units.sample[1])
        units.take_up_turns(i, counts)
        if not (self._goals.powered[i] or units.mode == "extended"):
            return  # moved by hand past the end of its encoder
        self._faults.turned[i] = self._faults.turned.get(i, 0) + turns
        self._prefix += units.frame("torque_enable", 0, [units.ids[i]])
        self._goals.drop([i])

    def _check(self, i: int, data: bytes) -> None:
        """Takes a motor's torque and stored goal."""
        base = self._units.check[0]
        self._goals.stored[i] = TABLE["goal_position"].decode(data, base)
        on = TABLE["torque_enable"].decode(data, base) == 1
        if on and self._let_go and not self._goals.powered[i]:
            self._words = self._limp  # a packet without an answer may be lost
        if not on and self._goals.powered[i]:
            self._faults.limp.add(i)
            self._goals.powered[i] = False

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
