"""What the fakes of serial servos share: the chain, the samples' delay, noise and losses."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.servo_chain import numbers
from srl.sim.devices.shared.windows import Windows, inside, require_cell, rising
from srl.sim.parts.servo_bus.chain import ServoChain
from srl.sim.parts.servo_bus.motors import Motors


class FakeServosConfig(FakeConfig):
    """Options of a fake of serial servos."""

    part: str | None = Field(default=None, description="the cell's chain; None: the one that fits")
    quantise: bool = Field(default=True, description="whole counts and units, as the registers give them")
    noise: float = Field(default=0.0, ge=0, description="counts, standard deviation of the encoders")
    delay: float = Field(default=0.001, ge=0, le=0.1, description="s, from a sample to its arrival, at least a cycle")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that an exchange isn't answered in full")
    loss: Annotated[Windows, AfterValidator(rising)] = Field(
        default=(), description="s, [from, to] pairs in world time during which the bus is gone"
    )


class FakeServos(Fake):
    """The servos of one bus of a chain.

    As on the real bus, a sample is requested in one cycle and arrives in a later one. Noise and drop-outs of the
    options depend only on the seed, the name and the number of the exchange. Exchanges are counted by world time from
    its start.
    """

    config: Any
    _options: Any  # FakeServosConfig

    def __init__(
        self, name: str, config: Any, world: World, options: FakeServosConfig, chain: type[ServoChain]
    ) -> None:
        """`chain`: the part's class. Raises WiringError: the world has none that fits."""
        super().__init__(name, config, world, options)
        self._config, self._options = config, options
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
            self._sample = self.world.time, np.array([*values, np.full(of.size, motors.voltage)])

    @abstractmethod
    def _deliver(self, found: Array, taken: int) -> None:
        """Gives a sample to the driver's signals.

        Args:
            found: counts, velocity, current, temperature, voltage (5, n).
            taken: when, ns of the world's time.
        """

    @staticmethod
    def _exchange(time: int) -> int:
        """The number of the exchange at `time`, ns."""
        return time // 1_000_000

    def _check(self) -> None:
        if not self.health.connected or inside(self._options.loss, self.world.time):
            self.health.connected = False
            raise DeviceLostError(
                self.name, "the simulated bus is gone", "It comes back at the end of its 'loss' window"
            )
