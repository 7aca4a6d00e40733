"""A bus of Dynamixel servos: sampled and commanded together, one exchange after another, without blocking.

In a cycle's `write` one packet carries all goals, followed by the next request for samples. A later cycle's `read`
takes the answers. Without commands `read` sends the requests itself. The answers show that the servos took the goals
in front of the request. So never more than one command is on its way (see `Line`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import WATCHDOG, Family, Family2, family
from srl.drivers.dynamixel.faults import DynamixelFaults
from srl.drivers.dynamixel.new_servo import NewDynamixel
from srl.drivers.dynamixel.recovery import Recovery
from srl.drivers.dynamixel.session import Session, who
from srl.drivers.dynamixel.setup import Bus, set_up, watchdog_code
from srl.drivers.servo_bus import declare
from srl.drivers.servo_bus.driver import ServoBus
from srl.drivers.servo_bus.goals import Goals
from srl.drivers.servo_bus.line import Line, Request
from srl.drivers.transport import Transport
from srl.runtime.contracts.signals import Command, Kind, Stop

_SUSPECT: Final = 0.8  # share of the watchdog's time without a packet after which it may have tripped


class Dynamixel(ServoBus):
    """Axes driven by MX and X servos.

    States, all (n,) in the profile's order of motors: `position` (rad; m of a prismatic axis), `velocity` (rad/s,
    m/s), `effort` (N m, N: from the current, or from the load of a model without), `temperature` (degC), `voltage` (V).
    Command: `position_command`, `velocity_command` or `effort_command`, by the profile's `mode`. A sample's stamp
    is the time of its request, so a sample is never older than its stamp. Source: protocol sheet dynamixel.
    """

    Config = DynamixelConfig
    summary = "Dynamixel MX and X servos on one bus, protocol 1.0 or 2.0"
    usb = ("0403:6014",)  # FTDI, in the U2D2
    takes: tuple[str, ...] = declare.COMMANDS
    config: DynamixelConfig
    _units: Family
    _faults: DynamixelFaults
    _bus: Bus | None

    def __init__(self, name: str, config: DynamixelConfig) -> None:
        units = family(config)
        command = _command(config, units.unit.tolist())
        super().__init__(name, config, units, DynamixelFaults(tuple(config.motors)), command)
        self._kind = command.kind
        self._suspect_after = round(_SUSPECT * config.watchdog * 1e9)
        self._zero = b"" if self._kind is Kind.POSITION else units.again()  # the goals are still 0 here
        self._forget()

    def _forget(self) -> None:
        super()._forget()
        self._goals = Goals(self._units, self._faults, self._kind)
        self._recovery: Recovery | None = None
        self._driven = False  # commanded since the last rest
        self._suspect = self._checked = False  # whether the watchdogs must be checked; whether that was just done
        self._sampling = False
        self._hold: tuple[bytes, tuple[bytes, ...]] = b"", ()  # goals, and the stop frame made of them
        filler = self._units.filler
        self._arm = self._watchdogs()
        self._limp_frames, self._zero_frames = (filler + self._limp * 2,), (filler + self._zero * 2,)

    def _watchdogs(self) -> bytes:
        """What clears and arms the watchdogs; a servo that one has stopped may have lost the bound of its effort."""
        units, code = self._units, watchdog_code(self.config.watchdog)
        if not isinstance(units, Family2):
            return b""
        bound = dict(zip(units.ids, units.pressure, strict=True))
        pressing = units.frame("goal_current", bound) if self.config.mode == "current-position" else b""
        return units.frame("bus_watchdog", 0) + pressing + units.frame("bus_watchdog", code)

    def _asker(self, link: Transport) -> Session:
        return Session(link, self._units, self.name)

    def _identify(self, asker: Session, scan: bool) -> Bus:
        return set_up(asker, scan)

    def _found(self, bus: Bus) -> None:
        for i, bits in enumerate(bus.errors):
            self._faults.hardware(i, bits, self._units.protocol)
        self.health.message = f"firmware {', '.join(map(str, bus.firmware))}"

    def stop(self, category: Stop) -> None:
        """LIMP switches the torque off; goals of velocity and effort become 0."""
        if self._line is None:
            return
        if category is Stop.LIMP:
            self._release()
        elif self._zero and not self._stop_packet:
            self._stop_packet = self._zero
        if self._send_stop():
            self._publish_stop()

    def close(self) -> None:
        """Servos hold their last position; velocity and effort become 0; the watchdog is off."""
        super().close()

    def _last(self) -> bytes:
        return (
            self._stop_packet
            + self._zero
            + (self._units.frame("bus_watchdog", 0) if self._units.protocol == 2 else b"")
        )

    @classmethod
    def new_servo(cls, config: DynamixelConfig, place: str) -> NewDynamixel:
        """What sets up servos as they come from their box; for `srl setup-servos`."""
        return NewDynamixel(config, place)

    @classmethod
    def who_is_at(cls, port: str) -> str:
        return who(port)

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
            frames = (self._units.filler + goals + goals,) if goals else ()
            self._hold = goals, frames
        return frames

    def recover(self, now: int) -> None:
        """Restarts servos with hardware errors and rearms tripped watchdogs.

        The torque stays off until the next `write` whose goal is near the servo's position.
        """
        faults, family, bus = self._faults, self._units, self._bus
        if self._line is None or bus is None or self._recovery is not None:
            return
        if faults.tripped:
            self._prefix += self._arm
            faults.tripped.clear()
        faults.far.clear()
        if not isinstance(family, Family2):
            overloaded = {self._units.ids[i]: bus.torque[i] for i in faults.errors}
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

    # -- an exchange

    def _ask(self, line: Line, now: int, commanding: bool) -> None:
        """Sends pending commands, followed by the next request."""
        request, alone = self._next(line, now)
        if request is None:
            return
        goals, waking = self._give() if commanding and not alone else (b"", [])
        if commanding:
            self._stop_packet = b""
        if line.send(request, now, self._prefix + self._stop_packet + goals):
            self._prefix = b""
            self._publish_stop()
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

    def _publish_stop(self) -> None:
        """Notes that the stop command has left; it may set goals of velocity and effort to 0."""
        if self._stop_packet and self._stop_packet == self._zero and self._goals.newest:
            self.sent_arrays[self.config.command][:] = 0.0
        self._stop_packet = b""

    def _idle(self) -> None:
        """Handles the end of commands, e.g. after a fault: velocity and effort goals must not stay in force."""
        if self._driven and self._zero:
            self._stop_packet = self._stop_packet or self._zero
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
        elif self._units.protocol == 1:
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
        answers, ids = request.answers, self._units.ids
        if len(answers) < len(ids):
            return  # a sample has values of all motors at one time; otherwise there is none
        data = b"".join([answers[id].data for id in ids])
        if len(data) != request.size * len(ids):
            return  # one motor reported an error instead of its data
        self._units.decode(data, request.size, self.state_arrays)
        self.health.stamp = request.sent
        self._sampled = True

    def _check(self, request: Request) -> None:
        """Takes each motor's torque enable, and its hardware error status or torque limit."""
        address, size = self._units.check
        for id, status in request.answers.items():
            i = self._number[id]
            if len(status.data) != size:
                continue
            registers = self._units.tables[i]
            if self._units.protocol == 2:
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
            self._faults.hardware(i, bits, self._units.protocol)
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


def _command(config: DynamixelConfig, unit: Sequence[float]) -> Command:
    """The command of the profile's `mode`, (n,); `unit` is that of the goal's register, in the command's (n,)."""
    timeout = watchdog_code(config.watchdog) * WATCHDOG if config.protocol == 2 else None
    return declare.command_of(config.motors, config.command, unit, timeout)
