"""What the fakes of sensors share: sampling, noise, delay and loss of the device."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from fractions import Fraction
from typing import ClassVar, Final, cast

from pydantic import Field

from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.windows import Windows, lose_while_gone, refuse_while_gone
from srl.sim.world.cell import Cell
from srl.sim.world.samples import Samples

_CATCH_UP: Final = 100  # most samples counted in one read


class SensorOptions(FakeConfig):
    """Options of every sensor's fake; a subclass sets its own defaults."""

    part: str | None = Field(default=None, description="the cell's part it measures; None: the one that fits")
    rate: float = Field(default=100.0, gt=0, le=4000, description="Hz, samples it takes")
    noise: float = Field(default=0.0, ge=0, description="standard deviation, in the fake's own noise units")
    delay: float = Field(default=0.0, ge=0, le=0.5, description="s, from sampling to arrival")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that a sample is lost on its way")
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the device is gone")


class SampledFake(Fake):
    """The common base of sampling fakes.

    Sample k is taken at world time k / rate. Its noise and loss depend only on seed, name and k.
    A subclass calls `sampled` in `__init__` and implements `fill`. The fake and its twin both take samples with
    `sample`, so they give the same values. `health.stamp` is the time at which the sample was taken.

    Attributes:
        latency: ns that the driver takes off a sample's time, as its profile says.
        noise_scale: factor of `options.noise` for each value of a sample: a number or (size,); set before `sampled`.
    """

    Options = SensorOptions
    noise_scale: float | Array = 1.0
    latency: int = 0
    needs: ClassVar[type[World]] = Cell

    def __init__(self, name: str, config: DeviceConfig, world: World, options: SensorOptions) -> None:
        super().__init__(name, config, world, options)
        if not isinstance(world, self.needs):
            raise WiringError(
                f"sim.devices.{name}",
                f"the world {type(world).__name__} has nothing that this fake could measure",
                "Set 'world: cell' and list its parts",
            )
        self._sensor_options = options
        self._delay = round(options.delay * 1e9)
        self._samples: Samples | None = None
        self._noise = SampleNoise(world.seed, name, 0, 0.0)
        self._last = -1  # number of the newest sample counted

    @property
    def cell(self) -> Cell:
        """The world."""
        return cast(Cell, self.world)

    def sampled(self, size: int, take: Callable[[], Array]) -> None:
        """Sets what is measured; called once, in `__init__`. `take` returns the present true values (size,)."""
        rate = Fraction(self._sensor_options.rate).limit_denominator(10**6)
        self._samples = self.cell.sample(rate, take, size)
        self._noise = SampleNoise(self.world.seed, self.name, size, self._sensor_options.noise, self.noise_scale)

    @abstractmethod
    def fill(self, values: Array, number: int) -> bool | None:
        """Writes sample `number` into the state arrays. Returns False if it is no sample for the driver."""

    def quantise(self, values: Array) -> Array:
        """Rounds `values` (size,) to the device's resolution; may change them in place."""
        return values

    # -- life cycle

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._sensor_options.loss, self.world.time)
        self._last = self.newest() - 1
        self.health.opened()

    def read(self, now: int) -> None:
        self.check_there()
        newest = self.newest()
        if newest == self._last:
            return
        if newest < self._last:  # the world was restored to an earlier state
            self._last = newest - 1
        arrived = -1
        for number in range(max(self._last + 1, newest - _CATCH_UP, 0), newest + 1):
            if self._is_lost(number):
                self.health.errors += 1
            else:
                self.health.frames += 1
                arrived = number
        self._last = newest
        # The newest sample that arrived is used; after a pause it may no longer be kept.
        if arrived < 0 or not self.samples.keeps(arrived):
            return
        if self.fill(self.arriving(arrived), arrived) is not False:
            stamp = now - (self.world.time - self.taken_at(arrived)) - self.latency
            self.health.stamp = max(stamp, self.health.stamp) if self.latency else stamp

    def close(self) -> None:
        self.health.connected = False

    def check_there(self) -> None:
        """Raises DeviceLostError while the device isn't open, or is gone; `read` does it, and `write` must."""
        lose_while_gone(self, self._sensor_options.loss)

    # -- the sensor itself, used by the fake and the twin

    def newest(self) -> int:
        """Number of the newest sample that has arrived by now; -1 before the first."""
        return self.samples.newest(self.world.time - self._delay)

    def taken_at(self, number: int) -> int:
        """World time at which a sample is taken, ns."""
        return self.samples.taken_at(number)

    def sample(self, number: int) -> Array | None:
        """The measured values (size,) of a sample at most a second old; None if it is lost."""
        return None if self._is_lost(number) else self.arriving(number)

    def arriving(self, number: int) -> Array:
        """The measured values (size,) of a sample that isn't lost."""
        measured = self.samples[number].copy()
        if self._sensor_options.noise:
            measured += self._noise.noise(number)
        return self.quantise(measured)

    @property
    def samples(self) -> Samples:
        """The true values at the sensor's sampling times."""
        assert self._samples is not None, "the fake didn't call `sampled`"
        return self._samples

    def _is_lost(self, number: int) -> bool:
        dropout = self._sensor_options.dropout
        return number < 0 or (dropout > 0.0 and self._noise.uniform(number) < dropout)


class AnyWorldFake(SampledFake):
    """A sampling fake for any world, not only a cell.

    Such a world doesn't call at the sampling times. So what is due is sampled when somebody asks for the newest sample.
    """

    needs: ClassVar[type[World]] = World  # type: ignore[type-abstract]  # any will do

    def __init__(self, name: str, config: DeviceConfig, world: World, options: SensorOptions) -> None:
        super().__init__(name, config, world, options)
        self._seen = 0  # ns, world time of the last look

    def sampled(self, size: int, take: Callable[[], Array], rate: float | None = None) -> None:
        """`rate`: Hz, in place of the options' one."""
        hz = Fraction(self._sensor_options.rate if rate is None else rate).limit_denominator(10**6)
        self._samples = Samples(hz, take, size)
        self._noise = SampleNoise(self.world.seed, self.name, size, self._sensor_options.noise, self.noise_scale)

    def newest(self) -> int:
        samples, time = self.samples, self.world.time
        if time < self._seen:  # the world was restored to an earlier state
            samples.taken = -1
        self._seen = time
        if samples.taken < 0:
            samples.taken = max(int(time * samples.period.denominator // samples.period.numerator) - 1, -1)
        while samples.due <= time:
            samples.take()
        return super().newest()
