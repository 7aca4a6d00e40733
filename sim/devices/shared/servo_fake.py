"""What the fakes of serial servos share: the chain, the samples' delay, noise and losses."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from pydantic import Field

from srl.drivers.servo_bus.faults import BEYOND, FAR, Faults
from srl.drivers.servo_bus.units import VOLT, Units
from srl.runtime.contracts.signals import Array, Kind
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.servo_chain import numbers
from srl.sim.devices.shared.windows import Windows, lose_while_gone, refuse_while_gone, require_cell
from srl.sim.parts.servo_bus.chain import ServoChain
from srl.sim.parts.servo_bus.motors import Motors


class FakeServosConfig(FakeConfig):
    """Options of a fake of serial servos."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    quantise: bool = Field(default=True, description="whole counts and units, as the registers give them")
    noise: float = Field(default=0.0, ge=0, description="counts, standard deviation of the encoders")
    delay: float = Field(default=0.001, ge=0, le=0.1, description="s, from a sample to its arrival, at least a cycle")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that an exchange isn't answered in full")
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the bus is gone")


class FakeServos(Fake):
    """The servos of one bus of a chain.

    As on the real bus, a sample is requested in one cycle and arrives in a later one. Noise and drop-outs of the
    options depend only on the seed, the name and the number of the exchange. Exchanges are counted by world time from
    its start.
    """

    config: Any
    units: Units
    _faults: Faults
    _options: Any  # FakeServosConfig

    def __init__(
        self, name: str, config: Any, world: World, options: FakeServosConfig, chain: type[ServoChain]
    ) -> None:
        """`chain`: the part's class. Raises WiringError: the world has none that fits."""
        super().__init__(name, config, world, options)
        self._config, self._options = config, options
        self._command = self.commands[0]
        self.chain = require_cell(world, name).part(chain, name, options.part)
        self.numbers = numbers(self.chain, config.motors, name)
        self._of = np.array(self.numbers)
        self._noise = SampleNoise(world.seed, name, len(self.numbers), options.noise)
        self._tolerance = config.start_tolerance * np.abs([motor.scale for motor in config.motors.values()])
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
        self._prepare()
        self._sample, self._sampled = None, False
        self._faults.clear()
        self.health.opened()
        self.health.message = "simulated servos"
        self._find_faults()

    def write(self, now: int) -> None:
        self._check()
        motors, faults, units = self.motors, self._faults, self.units
        if faults.tripped or not self._sampled:
            return
        command, where = self.command_arrays[self._command.name], self.state_arrays["position"]
        units.encode(command)
        bounded = units.bounded(command)
        near = np.abs(bounded - where) <= self._tolerance
        for k, i in enumerate(self.numbers):
            starts = not motors.torque[i]
            if starts and (faults.concerns(k) or self._is_away(k)):
                continue
            if starts and self._command.kind is Kind.POSITION and not near[k]:
                faults.far[k] = BEYOND if abs(command[k] - where[k]) <= self._tolerance[k] else FAR
                continue
            self._give(motors, i, int(units.last[k]))
            if starts:
                motors.switch(i, True)
            if np.isfinite(command[k]):
                self.sent_arrays[self._command.name][k] = bounded[k]
        self._find_faults()

    def close(self) -> None:
        """Servos hold their last position."""
        self.health.connected = False

    @abstractmethod
    def _prepare(self) -> None:
        """Sets the servos up when the bus is opened, as the driver does, and the limits that they then have."""

    @abstractmethod
    def _find_faults(self) -> None:
        """Names the servos' faults."""

    def _is_away(self, k: int) -> bool:
        """Whether motor `k` of the bus can't obey now."""
        return False

    def _give(self, motors: Motors, i: int, goal: int) -> None:
        """Sets a goal, given in the register's units."""
        motors.goal_position[i] = goal

    # -- an exchange

    def _arrive(self, now: int) -> None:
        """Takes the sample that was requested, once its time is over."""
        time = self.world.time
        if self._sample is not None and self._sample[0] > time:
            self._sample = None  # the world was restored to an earlier state
        if self._sample is None or time < self._sample[0] + round(self._options.delay * 1e9):
            return
        taken, found = self._sample
        self._sample = None
        if self._options.dropout and self._noise.uniform(self._exchange(taken)) < self._options.dropout:
            self.health.errors += 1
            return
        if self._options.noise:
            found[0] += np.rint(self._noise.noise(self._exchange(taken)))
        self._deliver(found, taken)
        self._sampled = True
        self.health.stamp = now - (time - taken)
        self.health.frames += len(self.numbers)

    def _request(self) -> None:
        """Requests the next sample, unless one is on its way."""
        if self._sample is None:
            motors, of = self.motors, self._of
            values = motors.counts[of], motors.velocity[of], motors.current[of], motors.temperature[of]
            self._sample = self.world.time, np.array([*values, motors.voltage[of]])

    def _deliver(self, found: Array, taken: int) -> None:
        """Gives a sample to the driver's signals.

        Args:
            found: counts, velocity, current, temperature, voltage (5, n).
            taken: when, ns of the world's time.
        """
        counts, velocity, current, temperature, voltage = found
        units, out = self.units, self.state_arrays
        speed, amps, volts = velocity / units.velocity_unit, current / units.current_unit, voltage / VOLT
        if self._options.quantise:
            speed, amps, volts, temperature = (np.rint(x) for x in (speed, amps, volts, temperature))
        units.seen = counts.astype(np.int64)
        np.multiply(counts, units.per_count, out=out["position"])
        out["position"] += units.offset
        np.multiply(speed, units.per_velocity, out=out["velocity"])
        np.multiply(amps, units.current_effort, out=out["effort"])
        out["temperature"][:] = temperature
        np.multiply(volts, VOLT, out=out["voltage"])

    @staticmethod
    def _exchange(time: int) -> int:
        """The number of the exchange at `time`, ns."""
        return time // 1_000_000

    def _check(self) -> None:
        lose_while_gone(self, self._options.loss)
