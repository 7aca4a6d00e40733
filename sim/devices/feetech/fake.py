"""A Feetech bus in the simulated world: the servos of a chain, as their driver sees them."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from srl.drivers.feetech import Feetech
from srl.drivers.feetech.config import FeetechConfig
from srl.drivers.feetech.faults import FeetechFaults, Watch
from srl.drivers.feetech.table import END, TABLE
from srl.drivers.feetech.units import CURRENT, VOLT, FeetechUnits
from srl.drivers.servo_bus.faults import BEYOND, FAR
from srl.drivers.servo_bus.models import PER_COUNT
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.servo_chain import numbers
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone, require_cell, rising
from srl.sim.parts.feetech.chain import FeetechChain
from srl.sim.parts.servo_bus.motors import EXTENDED, POSITION, Motors

_COMMAND = "position_command"
_ERRORS = 0x2F  # the bits of a servo's errors that this bus has


class FakeFeetechConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    quantise: bool = Field(default=True, description="whole counts and units, as the registers give them")
    noise: float = Field(default=0.0, ge=0, description="counts, standard deviation of the encoders")
    delay: float = Field(default=0.001, ge=0, le=0.1, description="s, from a sample to its arrival, at least a cycle")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that an exchange isn't answered in full")
    loss: Annotated[Windows, AfterValidator(rising)] = Field(
        default=(), description="s, [from, to] pairs in world time during which the bus is gone"
    )


class FakeFeetech(Fake):
    """The servos of one bus of the chain.

    A sample is requested in one cycle and arrives in a later one. When the bus is lost, the servos go on to their last
    goals: they have no watchdog. Noise and drop-outs depend only on the seed, the name and the number of the exchange.
    """

    Options = FakeFeetechConfig
    real = Feetech
    config: FeetechConfig

    def __init__(self, name: str, config: FeetechConfig, world: World, options: FakeFeetechConfig) -> None:
        super().__init__(name, config, world, options)
        self._config, self._options = config, options
        self.chain = require_cell(world, name).part(FeetechChain, name, options.part)
        self.numbers = numbers(self.chain, config.motors, name)
        self._of = np.array(self.numbers)
        self.units = FeetechUnits(config)
        self._noise = SampleNoise(world.seed, name, len(self.numbers), options.noise)
        self._tolerance = config.start_tolerance * np.abs([motor.scale for motor in config.motors.values()])
        self._faults = FeetechFaults(tuple(config.motors))
        self._sample: tuple[int, Array] | None = None  # (time of the sample, its values (5, n))
        self._sampled = False

    @property
    def motors(self) -> Motors:
        """The servos, with encoders read now; `numbers` are those of this bus."""
        return self.chain.measure()

    def looks(self) -> Array:
        return self.chain.angles()[self._of]

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
        time = self.world.time
        if self._sample is not None and self._sample[0] > time:
            self._sample = None  # the world was restored to an earlier state
        if self._sample is not None and time >= self._sample[0] + round(self._options.delay * 1e9):
            taken, found = self._sample
            self._sample = None
            if self._options.dropout and self._noise.uniform(taken // 1_000_000) < self._options.dropout:
                self.health.errors += 1
            else:
                self._deliver(found, taken)
                self.health.stamp = now - (time - taken)
                self.health.frames += len(self.numbers)
        self._find_faults()
        if self._sample is None:
            motors, of = self.motors, self._of
            motion = motors.counts[of], motors.velocity[of], motors.current[of]
            self._sample = time, np.array([*motion, motors.temperature[of], np.full(of.size, motors.voltage)])

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
        if self._options.noise:
            counts = counts + np.rint(self._noise.noise(taken // 1_000_000))
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
        self._sampled = True
        warning = self._watch.judge(out["temperature"], out["voltage"], taken, self._faults)
        self.health.message = f"simulated servos; {warning}" if warning else "simulated servos"

    def _find_faults(self) -> None:
        motors = self.chain.motors
        for k, i in enumerate(self.numbers):
            self._faults.bits(k, int(motors.errors[i]) & _ERRORS)
        self.health.fault = self._faults.text()

    def _check(self) -> None:
        if not self.health.connected or inside(self._options.loss, self.world.time):
            self.health.connected = False
            raise DeviceLostError(
                self.name, "the simulated bus is gone", "It comes back at the end of its 'loss' window"
            )
