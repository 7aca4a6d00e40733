"""A gamepad used by a scripted person."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field, field_validator

from srl.drivers.gamepad import Gamepad, GamepadConfig
from srl.drivers.gamepad.driver import AXES, BUTTONS
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake, FakeConfig, World
from srl.sim.devices.shared.windows import Windows, inside, refuse_while_gone

Points = tuple[tuple[float, float], ...]


class FakeGamepadConfig(FakeConfig):
    """Options of the fake."""

    axes: dict[str, Points] = Field(
        default_factory=dict, description="by name, [s, value] points of world time; straight lines between them"
    )
    dpad: dict[str, Points] = Field(default_factory=dict, description="x and y, as axes, rounded to -1, 0, 1")
    buttons: dict[str, Windows] = Field(
        default_factory=dict, description="by name, [from, to] pairs, s of world time, during which it is down"
    )
    noise: float = Field(default=0.0, ge=0, description="1, how far a stick at rest may be off its centre, at random")
    loss: Windows = Field(default=(), description="s, [from, to] pairs in world time during which the pad is unplugged")

    @field_validator("axes", "dpad", "buttons")
    @classmethod
    def _known(cls, value: dict[str, Any], info: Any) -> dict[str, Any]:
        known = {"axes": AXES, "dpad": ("x", "y"), "buttons": tuple(BUTTONS)}[info.field_name]
        for name in value:
            if name not in known:
                raise ValueError(f"'{name}' isn't one of {', '.join(known)}")
        return value


class FakeGamepad(Sensor, Fake):
    """Gives the script's values, with the pad's own resolution and the driver's dead zone."""

    Options = FakeGamepadConfig
    real = Gamepad

    def __init__(self, name: str, config: GamepadConfig, world: World, options: FakeGamepadConfig) -> None:
        super().__init__(name, config, world, options)
        self._dead_zone, self.script = config.dead_zone, options
        self._held: dict[str, float] = {}
        # A worn stick rests near its centre, always at the same place.
        self._rest = np.random.default_rng(world.seed).uniform(-options.noise, options.noise, 4)

    def hold(self, axis: str, value: float) -> None:
        """Somebody in this process holds an axis there, in place of its script. It is no part of the world's state."""
        self._held[axis] = value

    def open(self) -> None:
        refuse_while_gone(self.name, self.script.loss, self.world.time)
        self.health.opened()

    def read(self, now: int) -> None:
        if not self.health.connected or inside(self.script.loss, self.world.time):
            self.health.connected = False
            for values in self.state_arrays.values():
                values[:] = 0.0
            raise DeviceLostError(self.name, "the simulated pad is unplugged", "It comes back after its 'loss' window")
        axes = self.axes()
        out = self.state_arrays["axes"]
        for i in (0, 2):
            size = float(np.hypot(*axes[i : i + 2]))
            inner = self._dead_zone
            out[i : i + 2] = axes[i : i + 2] * (max(min(size, 1.0) - inner, 0.0) / (1 - inner) / max(size, 1e-9))
        out[4:] = axes[4:]
        self.state_arrays["dpad"][:] = self.dpad()
        self.state_arrays["buttons"][:] = self.buttons()
        self.health.frames += 1
        self.health.stamp = now

    def close(self) -> None:
        self.health.connected = False

    # -- the pad itself, used by the fake and the twin: what its hardware measures now

    def axes(self) -> Array:
        """(6,) sticks, right and up positive, measured in 16 bits; triggers, in 8 bits."""
        now, script = self.world.time, self.script.axes
        wanted = np.array([self._held.get(name, _at(script.get(name, ()), now)) for name in AXES])
        wanted[:4] = np.round(np.clip(wanted[:4] + self._rest, -1, 1) * 32767) / 32767
        wanted[4:] = np.round(np.clip(wanted[4:], 0, 1) * 255) / 255
        return wanted

    def dpad(self) -> Array:
        """(2,) values -1, 0 or 1; right and up positive."""
        return np.round([_at(self.script.dpad.get(axis, ()), self.world.time) for axis in ("x", "y")])

    def buttons(self) -> Array:
        """(11,) values 0 or 1."""
        return np.array([float(inside(self.script.buttons.get(name, ()), self.world.time)) for name in BUTTONS])


def _at(points: Points, time: int) -> float:
    if not points:
        return 0.0
    times, values = zip(*points, strict=True)
    return float(np.interp(time * 1e-9, times, values))
