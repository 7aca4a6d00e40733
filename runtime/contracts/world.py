"""The contract of a simulated world; fakes are its devices, the loop's SimClock turns its time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from runtime.contracts.driver import DeviceConfig, Driver
from runtime.contracts.signals import Array, Signal


class WorldConfig(BaseModel):
    """A world's options, under `sim:` in the profile beside `world`. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FakeConfig(BaseModel):
    """A fake's own options (noise, delay, drop-outs), under `sim.devices.<name>`. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class World(ABC):
    """Physics, the simulated person, and the truth about both.

    Attributes:
        time: ns since the world's start.
        duration: s until the person's recording is over; None where there is no end.
        finished: whether what was to be done in it is done: the run ends by itself.
        truth: what really is (joint angles, tips, contact forces); recorded, never wired to a controller.
        scenery: what stands there and never moves, for viewers: kind ("box", "cylinder", "capsule", "sphere"), size (m:
            half sizes; radius and half length), position (m), quaternion (w x y z), colour (red, green, blue, alpha).
    """

    Config: type[WorldConfig] = WorldConfig
    summary: str = ""

    def __init__(self, config: WorldConfig, seed: int) -> None:
        self.config = config
        self.seed = seed
        self.time = 0
        self.duration: float | None = None
        self.finished = False
        self.truth: tuple[Signal, ...] = ()
        self.scenery: list[dict[str, Any]] = []
        self.truth_arrays: Mapping[str, Array] = {}

    def bind(self, truth: Mapping[str, Array]) -> None:
        """Takes the arrays that `advance` leaves filled."""
        self.truth_arrays = truth

    @abstractmethod
    def advance(self, until: int) -> None:
        """Steps the physics up to `until` (ns of world time) and fills the truth arrays."""

    @abstractmethod
    def save(self) -> NDArray[np.float64]:
        """The whole state, with which `restore` goes on bit for bit."""

    @abstractmethod
    def restore(self, state: NDArray[np.float64]) -> None:
        """Goes back to a saved state."""

    def close(self) -> None:
        """Frees what it holds."""


class Fake(Driver):
    """A driver whose device is simulated: same states, same commands, same units as the real driver's.

    Attributes:
        real: the driver whose device it simulates. What that one declares before it is opened (options, summary,
            `max_age`, states, commands, home, limits) is the fake's, too, unless the class says otherwise. None: the
            fake declares it all itself.
    """

    Options: type[FakeConfig] = FakeConfig
    real: ClassVar[type[Driver] | None] = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.real is not None:
            own = {name for base in cls.__mro__[: cls.__mro__.index(Fake)] for name in vars(base)}
            for name in {"Config", "summary", "gives", "takes", "max_age"} - own:
                setattr(cls, name, getattr(cls.real, name))

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeConfig) -> None:
        super().__init__(name, config)
        self.world = world
        self.options = options
        if self.real is not None:
            real = self.real(name, config)
            self.states, self.commands, self.home, self.limits = real.states, real.commands, real.home, real.limits


class Twin(ABC):
    """A fake's other door: speaks the device's wire protocol, so a real driver or a vendor's client can talk to it.

    Attributes:
        address: what to put into the profile's `port` (a pty's path, `tcp://127.0.0.1:port`); after `open`.
    """

    def __init__(self, fake: Fake) -> None:
        self.fake = fake
        self.address = ""

    @abstractmethod
    def open(self) -> None:
        """Opens the pty or the listening socket (loopback only)."""

    @abstractmethod
    def service(self, now: int) -> None:
        """Takes what the client sent and sends what is due at `now` (ns of the twin's clock). Never blocks.

        A client that goes away and comes back is served again. The caller steps the world.
        """

    @abstractmethod
    def close(self) -> None:
        """Closes the door; always succeeds."""

    def figures(self) -> dict[str, object]:
        """What the device saw, for tests: frames taken, time of the last command, pulse widths."""
        return {}
