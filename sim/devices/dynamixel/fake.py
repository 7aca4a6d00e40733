"""A Dynamixel bus in the simulated world: the servos of a chain, as their driver sees them."""

from __future__ import annotations

from typing import Final

from srl.drivers.dynamixel import Dynamixel
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import Family, Family2, family
from srl.drivers.dynamixel.faults import DynamixelFaults
from srl.drivers.dynamixel.table import table
from srl.runtime.contracts.signals import Kind, Stop
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.servo_fake import FakeServos, FakeServosConfig
from srl.sim.parts.dynamixel.chain import DynamixelChain
from srl.sim.parts.servo_bus.motors import Motors

REBOOT: Final = 300_000_000  # ns that a servo takes to reboot


class FakeDynamixelConfig(FakeServosConfig):
    """Options of the fake."""


class FakeDynamixel(FakeServos):
    """The servos of one bus of the chain. When the bus is lost, they continue until their watchdog stops them."""

    Options = FakeDynamixelConfig
    real = Dynamixel
    config: DynamixelConfig
    units: Family
    _faults: DynamixelFaults

    def __init__(self, name: str, config: DynamixelConfig, world: World, options: FakeDynamixelConfig) -> None:
        super().__init__(name, config, world, options, DynamixelChain)
        self.units, self._faults = family(config), DynamixelFaults(tuple(config.motors))
        self._kind = self._command.kind
        self._amps = dict(zip(self.numbers, self.units.current_unit.tolist(), strict=True))
        self._fresh = [self._memory(i) for i in range(len(config.motors))]
        self._wrote = False
        self._back_at: dict[int, int] = {}  # world time, ns, at which each rebooting motor is back

    # -- life cycle

    def _prepare(self) -> None:
        motors, mode = self.motors, Family2.MODES[self._config.mode]
        for k, i in enumerate(self.numbers):
            if motors.mode[i] != mode:
                motors.mode[i] = mode
                motors.switch(i, False)
                motors.fold(i)
            motors.stopped[i] = motors.profile_velocity[i] = 0.0
            motors.goal_velocity[i] = motors.goal_current[i] = 0.0
            self._press(k)
        if self.units.seen is not None:
            for k, i in enumerate(self.numbers):
                self.units.take_up_turns(k, int(motors.counts[i]))
        self.limits = {self._config.command: self.units.set_limits(self._fresh)}

    def read(self, now: int) -> None:
        self._check()
        self._come_back()
        self._arrive(now)
        self._find_faults()
        if not self._wrote and self._kind is not Kind.POSITION:
            self._zero()
        self._wrote = False
        self._talk()

    def write(self, now: int) -> None:
        self._wrote = True
        super().write(now)

    def stop(self, category: Stop) -> None:
        """LIMP switches the torque off; velocity and effort goals become 0."""
        if not self.health.connected:
            return
        if category is Stop.LIMP:
            for i in self.numbers:
                self.motors.switch(i, False)
        elif self._kind is not Kind.POSITION:
            self._zero()

    def close(self) -> None:
        """Servos hold their last position; velocity and effort goals become 0; the watchdogs are switched off."""
        if self.health.connected:
            for i in self.numbers:
                self.chain.motors.watchdog[i] = 0.0
            if self._kind is not Kind.POSITION:
                self._zero()
        super().close()

    def recover(self, now: int) -> None:
        """Reboots servos with hardware errors and clears tripped watchdogs."""
        motors, faults = self.motors, self._faults
        for k in faults.tripped:
            motors.stopped[self.numbers[k]] = 0.0
        for k in faults.errors:
            self._back_at.setdefault(k, self.world.time + REBOOT)
        errors = faults.errors
        faults.clear()
        faults.errors = errors
        self._find_faults()

    # -- an exchange

    def _give(self, motors: Motors, i: int, goal: int) -> None:
        if self._kind is Kind.POSITION:
            motors.goal_position[i] = goal
        elif self._kind is Kind.VELOCITY:
            motors.goal_velocity[i] = goal * self.units.velocity_unit
        else:
            motors.goal_current[i] = goal * self._amps[i]

    def _press(self, k: int) -> None:
        """Bounds the effort of the bus' motor `k` in mode `current-position`."""
        if isinstance(self.units, Family2) and self._config.mode == "current-position":
            i = self.numbers[k]
            self.chain.motors.goal_current[i] = self.units.pressure[k] * self._amps[i]

    def _zero(self) -> None:
        """Sets velocity and effort goals to 0."""
        for i in self.numbers:
            self._give(self.chain.motors, i, 0)
        if (sent := self.sent_arrays.get(self._config.command)) is not None:
            sent[:] = 0.0

    def _talk(self) -> None:
        """Requests the next sample, which also resets the watchdogs (protocol 2)."""
        motors = self.motors
        if isinstance(self.units, Family2):
            for i in self.numbers:
                motors.watchdog[i] = self._config.watchdog
        if not self._back_at:
            self._request()

    def _is_away(self, k: int) -> bool:
        return k in self._back_at

    def _find_faults(self) -> None:
        motors = self.chain.motors
        for k, i in enumerate(self.numbers):
            bits = int(motors.errors[i])
            if motors.stopped[i] and motors.torque[i]:
                self._faults.tripped.add(k)
            if bits and k not in self._faults.errors:
                self._faults.hardware(k, bits, self.units.protocol)
        self.health.fault = self._faults.text()

    def _come_back(self) -> None:
        for k, at in list(self._back_at.items()):
            if self.world.time >= at:
                i, motors = self.numbers[k], self.motors
                motors.power_up(i)
                motors.mode[i] = Family2.MODES[self._config.mode]
                self._press(k)
                self.units.take_up_turns(k, int(motors.counts[i]))
                del self._back_at[k]
                self._faults.errors.pop(k, None)

    def _memory(self, k: int) -> bytes:
        """The registers of a servo in its delivery state, from address 0 up to the last one with limits."""
        motor = list(self._config.motors.values())[k]
        registers = table(motor.facts, self._config.protocol)
        memory = bytearray(147)
        for register in registers.values():
            if register.end <= len(memory):
                memory[register.address : register.end] = register.encode(register.default)
        return bytes(memory)
