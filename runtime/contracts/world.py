"""The contract of a simulated world. Fakes are its devices, and the loop's SimClock advances its time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from srl.runtime.contracts.driver import DeviceConfig, Driver
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.frames import Frames
from srl.runtime.contracts.renamed import refuse_old_names
from srl.runtime.contracts.signals import Array, Arrays, Signal
from srl.runtime.contracts.wearer import Wearer


class WorldConfig(BaseModel):
    """A world's options, next to `world` under `sim:` in the profile. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FakeConfig(BaseModel):
    """A fake's own options (noise, delay, drop-outs), under `sim.devices.<name>`. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class World(ABC):
    """The physics, the simulated person, and the ground truth about both.

    Attributes:
        time: ns since the world's start.
        duration: s until the end of the person's recording; None where there is no end.
        finished: True once the task in the world is done. The run then ends by itself.
        truth: signals of the ground truth (joint angles, tips, contact forces). They are recorded and never wired
            to a controller.
        scenery: objects that never move, for viewers: kind ("box", "cylinder", "capsule", "sphere"), size (m:
            half sizes; radius and half length), position (m), quaternion (w x y z), colour (red, green, blue, alpha).
        warnings, remarks: (key under `sim:`, text): what is probably wrong, and what a person should know.
        wearer: the simulated wearer that takes instructions; None where there isn't exactly one.
    """

    Config: type[WorldConfig] = WorldConfig
    summary: str = ""

    def __init__(self, config: WorldConfig, seed: int, frames: Frames | None = None) -> None:
        """`frames`: the profile's tree, in which things stand; None: an empty one."""
        self.frames = frames if frames is not None else Frames({})
        self.config = config
        self.seed = seed
        self.time = 0
        self.duration: float | None = None
        self.finished = False
        self.truth: tuple[Signal, ...] = ()
        self.scenery: list[dict[str, Any]] = []
        self.truth_arrays: Mapping[str, Array] = {}
        self.wearer: Wearer | None = None
        self.warnings: list[tuple[str, str]] = []
        self.remarks: list[tuple[str, str]] = []

    def bind(self, truth: Mapping[str, Array]) -> None:
        """Takes the arrays that `advance` fills."""
        self.truth_arrays = Arrays(truth)

    @abstractmethod
    def advance(self, until: int) -> None:
        """Steps the physics up to `until` (ns of world time) and fills the truth arrays."""

    @abstractmethod
    def save(self) -> NDArray[np.float64]:
        """Returns the whole state. After `restore` the world continues from it bit for bit."""

    @abstractmethod
    def restore(self, state: NDArray[np.float64]) -> None:
        """Returns the world to a saved state."""

    def close(self) -> None:
        """Releases the world's resources."""


class Fake(Driver):
    """A driver whose device is simulated: same states, same commands, same units as the real driver's.

    Attributes:
        real: the driver whose device it simulates. The fake takes over what this driver declares before `open`
            (options, summary, `max_age`, states, commands, home, limits, traffic). A class
            that declares one of them itself keeps its own. If None, the fake declares all itself.
    """

    Options: type[FakeConfig] = FakeConfig
    real: ClassVar[type[Driver] | None] = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if cls.real is not None:
            own = {name for base in cls.__mro__[: cls.__mro__.index(Fake)] for name in vars(base)}
            for name in {"Config", "summary", "gives", "takes", "max_age", "links", "pictured_as"} - own:
                setattr(cls, name, getattr(cls.real, name))

    def __init__(self, name: str, config: DeviceConfig, world: World, options: FakeConfig) -> None:
        super().__init__(name, config)
        self.world = world
        self.options = options
        if self.real is not None:
            real = self.real(name, config)
            self.states, self.commands, self.home, self.limits = real.states, real.commands, real.home, real.limits
            self.traffic = real.traffic

    def looks(self) -> Array:
        """(n,) where somebody who looks at the device sees its joints, in the command's order, rad or m.

        Only a calibration's simulated person asks. Raises NotImplementedError: its joints can't be seen.
        """
        raise NotImplementedError(self.name)


class Twin(ABC):
    """A fake's wire interface: it speaks the device's protocol, so a real driver or a vendor's client can connect.

    Attributes:
        address: the value for the profile's `port` (a pty's path, `tcp://127.0.0.1:port`); known after `open`.
    """

    def __init_subclass__(cls) -> None:
        """Refuses a twin with a method's name of before."""
        super().__init_subclass__()
        refuse_old_names(cls, {"figures": "metrics"})

    def __init__(self, fake: Fake) -> None:
        self.fake = fake
        self.address = ""

    @abstractmethod
    def open(self) -> None:
        """Opens the pty or the listening socket (loopback only)."""

    @abstractmethod
    def service(self, now: int) -> None:
        """Reads what the client sent and sends what is due at `now` (ns of the twin's clock). Never blocks.

        A client that disconnects and connects again is served again. The caller steps the world.
        """

    @abstractmethod
    def close(self) -> None:
        """Closes the pty or the socket; always succeeds."""

    def metrics(self) -> dict[str, object]:
        """Returns what the device received, for tests: frames taken, time of the last command, pulse widths."""
        return {}
