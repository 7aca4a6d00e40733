"""A bus of Feetech servos: sampled and commanded together, one exchange after another, without blocking.

In a cycle's `write` one packet carries all goals, followed by the next request for samples. A later cycle's `read`
takes the answers (see `Line`). The servos have no watchdog: without a word they hold their last goal for ever.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from srl.drivers.feetech import protocol
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.faults import FeetechFaults, Watch
from srl.drivers.feetech.goals import StoredGoals
from srl.drivers.feetech.new_servo import NewFeetech
from srl.drivers.feetech.opening import Bus, set_up, settings, who
from srl.drivers.feetech.table import TABLE
from srl.drivers.feetech.units import FeetechUnits
from srl.drivers.servo_bus import declare
from srl.drivers.servo_bus.asking import Asker
from srl.drivers.servo_bus.driver import ServoBus
from srl.drivers.servo_bus.line import Line, Request
from srl.runtime.contracts.signals import Stop

_COMMAND: Final = "position_command"


class Feetech(ServoBus):
    """Axes driven by STS servos.

    States, all (n,) in the profile's order of motors: `position` (rad; m of a prismatic axis), `velocity` (rad/s,
    m/s), `effort` (N m, N: from the current), `temperature` (degC), `voltage` (V). Command: `position_command`. A
    sample's stamp is the time of its request. Source: protocol sheet can_actuators, section 5.
    """

    Config = FeetechConfig
    summary = "Feetech STS bus servos (STS3215 of the SO-100/101, STS3250)"
    usb = ("1a86:55d3",)  # CH343, in the adapters that come with the SO-101
    takes: tuple[str, ...] = (_COMMAND,)
    config: FeetechConfig
    _units: FeetechUnits
    _faults: FeetechFaults
    _goals: StoredGoals
    _bus: Bus | None

    def __init__(self, name: str, config: FeetechConfig) -> None:
        units = FeetechUnits(config)
        command = declare.command_of(config.motors, _COMMAND, units.unit.tolist(), None)
        super().__init__(name, config, units, FeetechFaults(tuple(config.motors)), command)
        self._forget()

    def _forget(self) -> None:
        super()._forget()
        self._goals = StoredGoals(self._units, self._faults)
        self._unsure = False  # a servo was silent: it may have lost its power, so it is looked at before it gets a goal
        self._frames: tuple[bytes | None, tuple[bytes, ...], tuple[bytes, ...]] = None, (), ()  # goals; hold; LIMP

    def _identify(self, asker: Asker, scan: bool) -> Bus:
        return set_up(asker, self._units, scan)

    def _found(self, bus: Bus) -> None:
        self._units.seen = None
        self._watch = Watch(tuple(self.config.motors), bus.hottest, bus.voltages)
        for i, bits in enumerate(bus.errors):
            self._faults.bits(i, bits)
        self._message = f"firmware {', '.join(sorted(set(bus.firmware)))}"
        if len(set(bus.firmware)) > 1:
            self._message += " (mixed: some versions answer a sync read differently; update the older ones)"
        self.health.message = self._message

    def stop(self, category: Stop) -> None:
        """LIMP switches the torque off; after any other the servos hold their last goals."""
        if self._line is None or category is not Stop.LIMP:
            return
        self._release()
        if self._send_stop():
            self._stop_packet = b""

    @classmethod
    def new_servo(cls, config: FeetechConfig, place: str) -> NewFeetech:
        """What sets up servos as they come from their box; for `srl setup-servos`."""
        return NewFeetech(config, place)

    @classmethod
    def who_is_at(cls, port: str) -> str:
        return who(port)

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
            self._stop_packet = b""
        if line.send(request, now, self._prefix + self._stop_packet + goals):
            self._prefix = self._stop_packet = b""
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
            self._stop_packet = self._limp  # a packet without an answer may be lost
        if not on and self._goals.powered[i]:
            self._faults.limp.add(i)
            self._goals.powered[i] = False
