"""A Feetech bus in the simulated world: the servos of a chain, as their driver sees them."""

from __future__ import annotations

from srl.drivers.feetech import Feetech
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.faults import FeetechFaults, Watch
from srl.drivers.feetech.table import END, TABLE
from srl.drivers.feetech.units import VOLT, FeetechUnits
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.servo_fake import FakeServos, FakeServosConfig
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
    units: FeetechUnits
    _faults: FeetechFaults

    def __init__(self, name: str, config: FeetechConfig, world: World, options: FakeFeetechConfig) -> None:
        super().__init__(name, config, world, options, FeetechChain)
        self.units, self._faults = FeetechUnits(config), FeetechFaults(tuple(config.motors))

    # -- life cycle

    def _prepare(self) -> None:
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

    def read(self, now: int) -> None:
        self._check()
        self._arrive(now)
        self._find_faults()
        self._request()

    def stop(self, category: Stop) -> None:
        """LIMP switches the torque off; after any other the servos hold their last goals."""
        if self.health.connected and category is Stop.LIMP:
            for i in self.numbers:
                self.motors.switch(i, False)

    def recover(self, now: int) -> None:
        """Switches the torque of servos with errors off, which ends an overload."""
        for k in set(self._faults.errors):
            self.motors.switch(self.numbers[k], False)
        self._faults.clear()
        self._watch.forget()
        self._find_faults()

    # -- an exchange

    def _deliver(self, found: Array, taken: int) -> None:
        super()._deliver(found, taken)
        out = self.state_arrays
        warning = self._watch.judge(out["temperature"], out["voltage"], taken, self._faults)
        self.health.message = f"simulated servos; {warning}" if warning else "simulated servos"

    def _find_faults(self) -> None:
        motors = self.chain.motors
        for k, i in enumerate(self.numbers):
            self._faults.bits(k, int(motors.errors[i]) & _ERRORS)
        self.health.fault = self._faults.text()
