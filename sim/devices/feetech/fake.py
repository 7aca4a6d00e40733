"""A Feetech bus in the simulated world: the servos of a chain, as their driver sees them."""

from __future__ import annotations

import numpy as np

from srl.drivers.feetech import Feetech
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.faults import FeetechFaults, Watch
from srl.drivers.feetech.table import END, TABLE
from srl.drivers.feetech.units import CURRENT, VOLT, FeetechUnits
from srl.drivers.servo_bus.faults import BEYOND, FAR
from srl.drivers.servo_bus.models import PER_COUNT
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.servo_fake import FakeServos, FakeServosConfig
from srl.sim.devices.shared.windows import refuse_while_gone
from srl.sim.parts.feetech.chain import FeetechChain
from srl.sim.parts.servo_bus.motors import EXTENDED, POSITION

_COMMAND = "position_command"
_ERRORS = 0x2F  # the bits of a servo's errors that this bus has


class FakeFeetechConfig(FakeServosConfig):
    """Options of the fake."""


class FakeFeetech(FakeServos):
    """The servos of one bus of the chain. When the bus is lost, they go on to their last goals, without a watchdog."""

    Options = FakeFeetechConfig
    real = Feetech
    config: FeetechConfig

    def __init__(self, name: str, config: FeetechConfig, world: World, options: FakeFeetechConfig) -> None:
        super().__init__(name, config, world, options, FeetechChain)
        self.units = FeetechUnits(config)
        self._faults = FeetechFaults(tuple(config.motors))

    # -- life cycle

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._options.loss, self.world.time)
        motors, config = self.motors, self._config
        for k, i in enumerate(self.numbers):
            motors.mode[i] = EXTENDED if config.mode == "extended" else POSITION
            if self.units.seen is not None:
                self.units.take_up_turns(k, int(motors.counts[i]))
        memory = bytearray(END)
        for register in TABLE.values():
            memory[register.address : register.end] = register.encode(register.default)
        self.limits = {_COMMAND: self.units.set_limits([bytes(memory)] * len(self.numbers))}
        limit = [float(motors.temperature_limit[i]) for i in self.numbers]
        volts = TABLE["min_voltage_limit"].default * VOLT, TABLE["max_voltage_limit"].default * VOLT
        self._watch = Watch(tuple(config.motors), limit, [volts] * len(limit))
        self._sample, self._sampled = None, False
        self._faults.clear()
        self.health.opened()
        self.health.message = "simulated servos"
        self._find_faults()

    def read(self, now: int) -> None:
        self._check()
        self._arrive(now)
        self._find_faults()
        self._request()

    def write(self, now: int) -> None:
        self._check()
        motors, faults, units = self.motors, self._faults, self.units
        if not self._sampled:
            return
        command, where = self.command_arrays[_COMMAND], self.state_arrays["position"]
        units.encode(command)
        bounded = units.bounded(command)
        near = np.abs(bounded - where) <= self._tolerance
        for k, i in enumerate(self.numbers):
            if not motors.torque[i]:
                if faults.concerns(k):
                    continue
                if not near[k]:
                    faults.far[k] = BEYOND if abs(command[k] - where[k]) <= self._tolerance[k] else FAR
                    continue
                motors.goal_position[i] = int(units.last[k])  # before the torque: it drives to its goal at once
                motors.switch(i, True)
            motors.goal_position[i] = int(units.last[k])
            if np.isfinite(command[k]):
                self.sent_arrays[_COMMAND][k] = bounded[k]
        self._find_faults()

    def stop(self, category: Stop) -> None:
        """LIMP switches the torque off; after any other the servos hold their last goals."""
        if self.health.connected and category is Stop.LIMP:
            for i in self.numbers:
                self.motors.switch(i, False)

    def close(self) -> None:
        """Servos hold their last goals."""
        self.health.connected = False

    def recover(self, now: int) -> None:
        """Switches the torque of servos with errors off, which ends an overload."""
        for k in set(self._faults.errors):
            self.motors.switch(self.numbers[k], False)
        self._faults.clear()
        self._watch.forget()
        self._find_faults()

    # -- an exchange

    def _deliver(self, found: Array, taken: int) -> None:
        counts, velocity, current, temperature, voltage = found
        units, out = self.units, self.state_arrays
        speed, amps, volts = velocity / PER_COUNT, current / CURRENT, voltage / VOLT
        if self._options.quantise:
            speed, amps, volts, temperature = (np.rint(x) for x in (speed, amps, volts, temperature))
        units.seen = counts.astype(np.int64)
        np.multiply(counts, units.per_count, out=out["position"])
        out["position"] += units.offset
        np.multiply(speed, units.per_count, out=out["velocity"])
        np.multiply(amps, units.current_effort, out=out["effort"])
        out["temperature"][:] = temperature
        np.multiply(volts, VOLT, out=out["voltage"])
        warning = self._watch.judge(out["temperature"], out["voltage"], taken, self._faults)
        self.health.message = f"simulated servos; {warning}" if warning else "simulated servos"

    def _find_faults(self) -> None:
        motors = self.chain.motors
        for k, i in enumerate(self.numbers):
            self._faults.bits(k, int(motors.errors[i]) & _ERRORS)
        self.health.fault = self._faults.text()
