"""A CyberGlove on the simulated hand, with sampling, noise, delay, resolution and loss of the device."""

from __future__ import annotations

from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from srl.drivers.cyberglove import CyberGlove, calibration
from srl.drivers.cyberglove.calibration import Calibration
from srl.drivers.cyberglove.driver import CyberGloveConfig
from srl.drivers.cyberglove.protocol import LABELS, LABELS_22
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.noise import SampleNoise
from srl.sim.devices.shared.windows import Windows, inside, lose_while_gone, refuse_while_gone, require_cell
from srl.sim.parts.hand.human_hand import HumanHandPart
from srl.sim.wearer.joints import GLOVE_OF_HAND

_CATCH_UP: Final = 100  # most samples counted in one read
_LOOK_BACK: Final = 10  # samples; more than are lost in a row


class FakeCyberGloveConfig(FakeConfig):
    """Options of the fake."""

    part: str | None = Field(default=None, description="the cell's hand that wears it; None: the one that fits")
    rate: float = Field(default=100.0, gt=0, le=1000, description="Hz, samples the glove takes by its own clock")
    noise: float = Field(default=0.004, ge=0, description="rad, standard deviation of each sensor, before quantisation")
    delay: float = Field(default=0.008, ge=0, le=0.5, description="s, from sampling to arrival")
    quantise: bool = Field(default=True, description="angles as raw bytes give them, as the real glove's")
    characteristic: dict[str, calibration.Fit] = Field(
        default={}, description="how sensors of the glove truly bend, by name; others: as its calibration says"
    )
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that a sample is lost on its way")
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the glove is gone")
    switch: Windows = Field(default=(), description="s, [from, to] pairs during which the wrist switch is on")


class FakeCyberGlove(Sensor, Fake):
    """Samples the joint angles of the simulated hand.

    Sample k is taken at world time k / rate. Noise and losses depend only on seed, name and k. So the fake has no
    state of its own that a restored world would have to restore. `health.stamp` is the time at which the sample
    was taken.
    """

    Options = FakeCyberGloveConfig
    real = CyberGlove

    def __init__(self, name: str, config: CyberGloveConfig, world: World, options: FakeCyberGloveConfig) -> None:
        super().__init__(name, config, world, options)
        self.hand = require_cell(world, name).part(HumanHandPart, name, options.part)
        self._config, self._options = config, options
        self._of_hand = GLOVE_OF_HAND[[LABELS_22.index(label) for label in LABELS[config.sensors]]]
        self._delay = round(options.delay * 1e9)
        self.set_period(Fraction(10**9) / Fraction(options.rate).limit_denominator(10**6))
        self._noise = SampleNoise(world.seed, name, config.sensors, options.noise)
        self._raw = config.raw
        self._calibration: calibration.Calibration | None = None
        self._truth: Calibration | None = None
        for sensor in options.characteristic:
            if sensor not in LABELS[config.sensors]:
                place = f"sim.devices.{name}.characteristic.{sensor}"
                problem = f"a glove of {config.sensors} sensors has none of this name"
                raise ProfileError(place, problem, nearest(sensor, LABELS[config.sensors]))

    def open(self) -> None:
        self.close()
        refuse_while_gone(self.name, self._options.loss, self.world.time)
        self.calibration()
        self._last = self.newest() - 1
        self.health.opened()
        self.health.message = "" if self._raw else self.calibration().note

    def read(self, now: int) -> None:
        lose_while_gone(self, self._options.loss)
        newest = self.newest()
        if newest < self._last:  # the world was restored: back to what had arrived by then
            self._last = newest - _LOOK_BACK
        arrived = -1
        for number in range(max(self._last + 1, newest - _CATCH_UP, 0), newest + 1):
            if self._is_lost(number):
                self.health.errors += 1
            else:
                self.health.frames += 1
                arrived = number
        self._last = newest
        if arrived < 0:
            return
        angles, taken = self._measured(arrived), self.taken_at(arrived)
        if self._raw:
            self.state_arrays["raw"][:] = self.raw(angles)
        elif self._options.characteristic:
            self.calibration().angles(self.raw(angles).tobytes(), self.state_arrays["position"])
        elif self._options.quantise:
            self.calibration().quantise(angles, self.state_arrays["position"])
        else:
            self.state_arrays["position"][:] = angles
        self.state_arrays["buttons"][0] = self.switch(taken)
        self.health.stamp = now - (self.world.time - taken)

    def close(self) -> None:
        self.health.connected = False

    # -- the glove itself, used by the fake and the twin

    def newest(self) -> int:
        """Number of the newest sample that has arrived by now; -1 before the first."""
        return (self.world.time - self._delay) * self._per // self._ns

    @property
    def period(self) -> Fraction:
        """World time between samples, ns."""
        return Fraction(self._ns, self._per)

    def set_period(self, period: Fraction) -> None:
        """Takes samples at whole multiples of `period` (ns) from now on, as the glove's command T sets it."""
        self._ns, self._per = period.as_integer_ratio()
        self._last = self.newest()  # number of the newest sample counted

    def taken_at(self, number: int) -> int:
        """World time at which a sample is taken, ns."""
        return number * self._ns // self._per

    def sample(self, number: int) -> Array | None:
        """The sensors' angles (n,), rad, with noise; None if the sample is lost. It must be at most 0.6 s old."""
        return None if number < 0 or self._is_lost(number) else self._measured(number)

    def raw(self, angles: Array) -> NDArray[np.uint8]:
        """(n,) bytes 1..255, as the glove truly bends; beyond its ends a sensor saturates."""
        return self._true().raw(angles)

    def switch(self, at: int) -> bool:
        """Whether the wrist switch is on at world time `at` (ns)."""
        return inside(self._options.switch, at)

    def calibration(self) -> calibration.Calibration:
        """The calibration set in the device's options.

        Raises:
            ProfileError: its file is wrong.
        """
        if self._calibration is None:
            file, sensors = self._config.calibration, self._config.sensors
            self._calibration = calibration.load(file, sensors) if file else calibration.default(sensors)
        return self._calibration

    def _true(self) -> Calibration:
        """How the glove truly bends. Raises ProfileError: the calibration's file is wrong."""
        if self._truth is None:
            own, known = self._options.characteristic, self.calibration()
            labels = LABELS[self._config.sensors]
            rows = [own[name].angles() if name in own else known.table[i] for i, name in enumerate(labels)]
            self._truth = Calibration(np.array(rows)) if own else known
        return self._truth

    def _is_lost(self, number: int) -> bool:
        dropout = self._options.dropout
        return dropout > 0.0 and self._noise.uniform(number) < dropout

    def _measured(self, number: int) -> Array:
        """The measured angles (n,), rad, with noise."""
        angles = self._of_hand.dot(self.hand.position(self.taken_at(number)))
        if self._options.noise:
            angles += self._noise.noise(number)
        return angles
