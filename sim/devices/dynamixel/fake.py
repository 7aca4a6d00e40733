"""A Dynamixel bus in the simulated world: the servos of a chain, as their driver sees them."""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import AfterValidator, Field

from srl.drivers.dynamixel import Dynamixel
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.dynamixel.family import Family, Family2, family
from srl.drivers.dynamixel.faults import DynamixelFaults
from srl.drivers.dynamixel.table import CURRENT, EXTENDED, POSITION, VELOCITY, table
from srl.drivers.servo_bus.faults import BEYOND, FAR
from srl.runtime.contracts.errors import DeviceLostError, WiringError
from srl.runtime.contracts.signals import Array, Kind, Stop
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.servo_chain import numbers
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone, rising
from srl.sim.parts.dynamixel.chain import DynamixelChain
from srl.sim.parts.servo_bus.motors import Motors
from srl.sim.world.cell import Cell

REBOOT: Final = 300_000_000  # ns that a servo takes to reboot
_MODES: Final = {"position": POSITION, "extended": EXTENDED, "velocity": VELOCITY, "effort": CURRENT}


class FakeDynamixelConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    quantise: bool = Field(default=True, description="whole counts and units, as the registers give them")
    noise: float = Field(default=0.0, ge=0, description="counts, standard deviation of the encoders")
    delay: float = Field(default=0.001, ge=0, le=0.1, description="s, from a sample to its arrival, at least a cycle")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that an exchange isn't answered in full")
    loss: Annotated[Windows, AfterValidator(rising)] = Field(
        default=(), description="s, [from, to] pairs in world time during which the bus is gone"
    )


class FakeDynamixel(Fake):
    """The servos of one bus of the chain.

    As on the real bus, a sample is requested in one cycle and arrives in a later one; goals are sent in between.
    When the bus is lost, servos continue until their watchdog stops them. Noise and drop-outs of the options depend
    only on the seed, the name and the number of the exchange. Exchanges are counted by world time from its start.
    """

    Options = FakeDynamixelConfig
    real = Dynamixel
    config: DynamixelConfig

    def __init__(self, name: str, config: DynamixelConfig, world: World, options: FakeDynamixelConfig) -> None:
        super().__init__(name, config, world, options)
        if not isinstance(world, Cell):
            raise WiringError(
                f"sim.devices.{name}",
                f"the world {type(world).__name__} has no servos for this fake",
                "Set 'world: cell' and list a part of kind dynamixel-chain",
            )
        self._config, self._options = config, options
        self._kind = self.commands[0].kind
        self.chain = world.part(DynamixelChain, name, options.part)
        self.numbers = numbers(self.chain, config.motors, name)
        self._of = np.array(self.numbers)
        self.family: Family = family(config)
        self._fresh = [self._memory(i) for i in range(len(config.motors))]
        self._noise = SampleNoise(world.seed, name, len(self.numbers), options.noise)
        self._tolerance = config.start_tolerance * np.abs([motor.scale for motor in config.motors.values()])
        self._faults = DynamixelFaults(tuple(config.motors))
        self._sample: tuple[int, Array] | None = None  # (time of the sample, its values (5, n))
        self._sampled = self._wrote = False
        self._back_at: dict[int, int] = {}  # world time, ns, at which each rebooting motor is back

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
        motors, mode = self.motors, _MODES[self._config.mode]
        for i in self.numbers:
            if motors.mode[i] != mode:
                motors.mode[i] = mode
                motors.switch(i, False)
                motors.fold(i)
            motors.stopped[i] = motors.profile_velocity[i] = 0.0
            motors.goal_velocity[i] = motors.goal_current[i] = 0.0
        if self.family.seen is not None:
            for k, i in enumerate(self.numbers):
                self.family.take_up_turns(k, int(motors.counts[i]))
        self.limits = {self._config.command: self.family.set_limits(self._fresh)}
        self._sample, self._sampled = None, False
        self._faults.clear()
        self.health.opened()
        self.health.message = "simulated servos"
        self._find_faults()

    def read(self, now: int) -> None:
        self._check()
        self._come_back()
        time = self.world.time
        if self._sample is not None and self._sample[0] > time:
            self._sample = None  # the world was restored to an earlier state
        if self._sample is not None and time >= self._sample[0] + round(self._options.delay * 1e9):
            taken, found = self._sample
            self._sample = None
            if self._options.dropout and self._noise.uniform(self._exchange(taken)) < self._options.dropout:
                self.health.errors += 1
            else:
                self._deliver(found, taken)
                self.health.stamp = now - (time - taken)
                self.health.frames += len(self.numbers)
        self._find_faults()
        if not self._wrote and self._kind is not Kind.POSITION:
            self._zero()
        self._wrote = False
        self._talk(time)

    def write(self, now: int) -> None:
        self._check()
        self._wrote = True
        motors, faults = self.motors, self._faults
        if faults.tripped or not self._sampled:
            return
        command = self.command_arrays[self._config.command]
        self.family.encode(command)
        where = self.state_arrays["position"]
        bounded = self.family.bounded(command)
        near = np.abs(bounded - where) <= self._tolerance
        for k, i in enumerate(self.numbers):
            if not motors.torque[i]:
                if faults.concerns(k) or k in self._back_at:
                    continue
                if self._kind is Kind.POSITION and not near[k]:
                    faults.far[k] = BEYOND if abs(command[k] - where[k]) <= self._tolerance[k] else FAR
                    continue
                motors.switch(i, True)
            self._give(motors, i, int(self.family.last[k]))
            if np.isfinite(command[k]):
                self.sent_arrays[self._config.command][k] = bounded[k]
        self._find_faults()

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
        self.health.connected = False

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
        """Sets a goal, given in the register's units."""
        if self._kind is Kind.POSITION:
            motors.goal_position[i] = goal
        elif self._kind is Kind.VELOCITY:
            motors.goal_velocity[i] = goal * self.family.velocity_unit
        else:
            motors.goal_current[i] = goal * self.family.current_unit

    def _zero(self) -> None:
        """Sets velocity and effort goals to 0."""
        for i in self.numbers:
            self._give(self.chain.motors, i, 0)
        if (sent := self.sent_arrays.get(self._config.command)) is not None:
            sent[:] = 0.0

    def _talk(self, time: int) -> None:
        """Requests the next sample, which also resets the watchdogs (protocol 2)."""
        motors = self.motors
        if isinstance(self.family, Family2):
            for i in self.numbers:
                motors.watchdog[i] = self._config.watchdog
        if self._sample is None and not self._back_at:
            of = self._of
            motion = motors.counts[of], motors.velocity[of], motors.current[of]
            self._sample = time, np.array([*motion, motors.temperature[of], np.full(of.size, motors.voltage)])

    def _deliver(self, found: Array, taken: int) -> None:
        counts, velocity, current, temperature, voltage = found
        f, out = self.family, self.state_arrays
        if self._options.noise:
            counts = counts + np.rint(self._noise.noise(self._exchange(taken)))
        speed, amps, volts = velocity / f.velocity_unit, current / f.current_unit, voltage / 0.1
        if self._options.quantise:
            speed, amps, volts, temperature = (np.rint(x) for x in (speed, amps, volts, temperature))
        f.seen = counts.astype(np.int32)
        np.multiply(counts, f.per_count, out=out["position"])
        out["position"] += f.offset
        np.multiply(speed, f.per_velocity, out=out["velocity"])
        np.multiply(amps, f.current_effort, out=out["effort"])
        out["temperature"][:] = temperature
        np.multiply(volts, 0.1, out=out["voltage"])
        self._sampled = True

    def _exchange(self, time: int) -> int:
        """The number of the exchange at `time`, ns."""
        return time // 1_000_000

    def _find_faults(self) -> None:
        motors = self.chain.motors
        for k, i in enumerate(self.numbers):
            bits = int(motors.errors[i])
            if motors.stopped[i] and motors.torque[i]:
                self._faults.tripped.add(k)
            if bits and k not in self._faults.errors:
                self._faults.hardware(k, bits, self.family.protocol)
        self.health.fault = self._faults.text()

    def _come_back(self) -> None:
        for k, at in list(self._back_at.items()):
            if self.world.time >= at:
                i, motors = self.numbers[k], self.motors
                motors.power_up(i)
                motors.mode[i] = _MODES[self._config.mode]
                self.family.take_up_turns(k, int(motors.counts[i]))
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

    def _check(self) -> None:
        if not self.health.connected or inside(self._options.loss, self.world.time):
            self.health.connected = False
            raise DeviceLostError(
                self.name, "the simulated bus is gone", "It comes back at the end of its 'loss' window"
            )
