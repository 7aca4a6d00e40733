"""Brings servos back after a hardware error or a loss of power, between the loop's own requests."""

from __future__ import annotations

from collections.abc import Generator
from typing import Final

from srl.drivers.dynamixel import protocol2
from srl.drivers.dynamixel.family import Family2
from srl.drivers.dynamixel.faults import DynamixelFaults
from srl.drivers.dynamixel.setup import watchdog_code
from srl.drivers.servo_bus.line import Request
from srl.drivers.servo_bus.register import Register

TIMEOUT: Final = 3_000_000_000  # ns a servo may take to come back from a reboot
PAUSE: Final = 200_000_000  # ns between attempts

Script = Generator[Request | None, int, None]  # yields the next request, or None to wait; receives the time


class Recovery:
    """The reboot of some servos of protocol 2; the other servos are still sampled in the meantime.

    Attributes:
        away: ids of the servos that can't be sampled now.
    """

    def __init__(self, family: Family2, faults: DynamixelFaults, reboot: set[int], now: int) -> None:
        """
        Args:
            reboot: numbers of the motors to restart; those in `faults.limp` are only set up again.
            now: ns.
        """
        self._family, self._faults = family, faults
        self._motors = sorted(reboot | faults.limp)
        self._reboot = reboot
        self.away = {family.ids[i] for i in self._motors}
        self._script = self._run(now)
        self._next: Request | None = None
        self._began = False

    def step(self, now: int) -> tuple[bool, Request | None]:
        """Returns whether the recovery goes on, and the request to send now; call it again when that has ended."""
        try:
            if self._began:
                return True, self._script.send(now)
            self._began = True
            return True, next(self._script)
        except StopIteration:
            return False, None

    def _run(self, now: int) -> Script:
        wire, faults = self._family.wire, self._faults
        for i in self._motors:
            if i in self._reboot:
                id = self._family.ids[i]
                now = yield Request(protocol2.reboot(id), (id,), 0, "recovery")
        end, later = now + TIMEOUT, now + PAUSE * bool(self._reboot)
        waiting = list(self._motors)
        while waiting:
            while now < later:
                now = yield None
            for i in list(waiting):
                id = self._family.ids[i]
                ask = Request(wire.ping(id), (id,), wire.PING_SIZE, "recovery")
                now = yield ask
                if ask.complete and (yield from self._set_up(i)):
                    waiting.remove(i)
            if waiting and now > end:
                break
            later = now + PAUSE
        faults.stubborn |= set(waiting)

    def _set_up(self, i: int) -> Generator[Request | None, int, bool]:
        """Takes the servo's remaining errors and arms its watchdog; returns False if this isn't possible yet."""
        family, id = self._family, self._family.ids[i]
        registers = family.tables[i]
        address, size = family.check
        ask = Request(family.wire.read(id, address, size), (id,), size, "recovery")
        yield ask
        if not ask.complete or len(ask.answers[id].data) != size:
            return False
        data = ask.answers[id].data
        self._faults.errors.pop(i, None)
        self._faults.hardware(i, registers["hardware_error_status"].decode(data, address), 2)
        for key, value in [*family.volatile(i).items(), ("bus_watchdog", watchdog_code(family.config.watchdog))]:
            ask = self._write(id, registers[key], value)
            yield ask
            if not ask.complete or ask.answers[id].error:
                return False
        if not (yield from self._find_turn(i)):
            return False
        self._faults.limp.discard(i)
        self._faults.stubborn.discard(i)
        self.away.discard(id)
        return True

    def _find_turn(self, i: int) -> Generator[Request | None, int, bool]:
        """Restores the turn count: a servo counts its turns only while it has power."""
        family, id = self._family, self._family.ids[i]
        register = family.tables[i]["present_position"]
        ask = Request(family.wire.read(id, register.address, register.size), (id,), register.size, "recovery")
        yield ask
        if not ask.complete or len(ask.answers[id].data) != register.size:
            return False
        family.take_up_turns(i, register.decode(ask.answers[id].data, register.address))
        return True

    def _write(self, id: int, register: Register, value: int) -> Request:
        frame = self._family.wire.write(id, register.address, register.encode(value))
        return Request(frame, (id,), 0, "recovery")
