"""A simulated Franka robot, shared by the fake and the twin: arm, sensors, controller, network."""

from __future__ import annotations

import zlib
from collections import deque
from enum import Enum
from struct import Struct
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field, field_validator

from srl.drivers.panda.packets import RobotMode, command_dtype
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.world import FakeConfig, World
from srl.sim.devices.panda.controller import PandaController
from srl.sim.devices.panda.motion import Setpoint
from srl.sim.devices.panda.state import Sensors, StateWriter
from srl.sim.devices.shared.windows import Windows, inside
from srl.sim.parts.robots.panda import PandaPart
from srl.sim.world.cell import Cell

TICK: Final = 1_000_000  # ns
_BLOCK: Final = 128  # number of ticks whose random numbers are drawn together
_CATCH_UP: Final = 100  # most ticks made up for at once
# A command's message id, q_c and dq_c, end of the motion, torques, end of the torques: many times as quick as a record.
_COMMAND: Final = {5: Struct("<Q7d7d192xx?7d"), 10: Struct("<Q7d7d192xx?7d?")}


class FakePandaConfig(FakeConfig):
    """Options of the fake. Windows are [from, to] pairs in s of world time."""

    part: str | None = Field(default=None, description="the cell's part it drives; null: the one that fits")
    robot: Literal["panda", "fr3"] | None = Field(default=None, description="whose limits; null: the part's")
    protocol: Literal[5, 10] | None = Field(default=None, description="FCI's; null: 5 for a panda, 10 for an fr3")
    position_noise: float = Field(default=1e-5, ge=0, description="rad, standard deviation of q")
    velocity_noise: float = Field(default=1e-3, ge=0, description="rad/s, of dq")
    effort_noise: float = Field(default=0.02, ge=0, description="N m, of tau_J and of the external torques")
    delay: int = Field(default=0, ge=0, le=15, description="ms that a command takes longer than to the next tick")
    dropout: float = Field(default=0.0, ge=0, le=1, description="probability that a command is lost")
    deaf: Windows = Field(default=(), description="no command arrives")
    loss: Windows = Field(default=(), description="the robot is gone: no power, or the cable is out")
    user_stop: Windows = Field(default=(), description="the user stop is pressed: brakes")
    host: str = Field(default="127.0.0.1", description="the twin's address; libfranka wants port 1337: 127.0.0.3")
    port: int = Field(default=0, ge=0, le=65535, description="the twin's command port; 0: any that is free")
    lockstep: bool = Field(
        default=False, description="the twin's time waits for the answer to each state, for tests on busy machines"
    )
    patience: float = Field(
        default=0.25, gt=0, le=0.9, description="s of real time that lockstep waits; then packets count as lost"
    )

    @field_validator("host")
    @classmethod
    def _loopback(cls, host: str) -> str:
        if not host.startswith("127."):
            raise ValueError("a twin listens on loopback only: 127.0.0.1, 127.0.0.2 ...")
        return host


class Heard(Enum):
    """What happened to a datagram."""

    WRONG = "no command"
    IDLE = "no motion wants it"
    LATE = "answers an older state than the newest: lost"
    TAKEN = "taken"


class PandaRobot:
    """The robot; each call of `step` advances its time by 1 ms, and its caller keeps it in step with the world.

    Attributes:
        controller: the robot's controller.
        version: version of the FCI protocol.
        writer: its newest state, written by `write`.
    """

    def __init__(self, name: str, world: World, options: FakePandaConfig) -> None:
        if not isinstance(world, Cell):
            raise WiringError(
                f"sim.devices.{name}",
                f"the world {type(world).__name__} has no Franka arm",
                "Set 'world: cell' and give it a part 'panda'",
            )
        part = world.part(PandaPart, name, options.part)
        self.world, self.options, self.part = world, options, part
        self.model = options.robot or part.robot.name
        self.version: int = options.protocol or (10 if self.model == "fr3" else 5)
        self._command = _COMMAND[self.version]
        assert self._command.size == command_dtype(self.version).itemsize
        key = [world.seed, zlib.crc32(name.encode())]
        noise = options.position_noise, options.velocity_noise, options.effort_noise
        self.sensors = Sensors(part, key, noise)
        self.controller = PandaController(self.sensors, self.model, part.declared, self._stopped)
        self.writer = StateWriter(self.controller, self.sensors, self.version)
        self._key = [*key, 1]
        self._block = -1
        self._uniform: list[float] = []
        self._line: deque[tuple[int, Setpoint]] = deque(maxlen=64)  # with the ticks at which they arrive
        self._last = world.time // TICK
        self.write()

    def elapsed(self) -> int:
        """Milliseconds of world time since the last call, at most 100; 0 if the world went back in time."""
        now = self.world.time // TICK
        last, self._last = self._last, now
        return min(max(now - last, 0), _CATCH_UP)

    def receive(self, data: bytes) -> Heard:
        """Takes a RobotCommand; returns what happened to it."""
        controller = self.controller
        if len(data) != self._command.size:
            return Heard.WRONG
        if controller.mode is not RobotMode.MOVE:
            return Heard.IDLE
        values = self._command.unpack(data)
        if values[0] != controller.ticks:
            return Heard.LATE
        finished = values[15] or any(values[23:])
        self.deliver(Setpoint(values[1:8], values[8:15], values[16:23], finished))
        return Heard.TAKEN

    def deliver(self, setpoint: Setpoint) -> None:
        """Sends a command to the robot, with the delay and losses of the options."""
        options, tick = self.options, self.controller.ticks + 1
        if inside(options.deaf, self.world.time) or (options.dropout and self._draw(tick) < options.dropout):
            return
        self._line.append((tick + options.delay, setpoint))

    def step(self, counts: bool = True) -> bool:
        """Advances 1 ms with the newest command that has arrived; returns whether there was one.

        `counts`: see `PandaController.tick`.
        """
        tick, setpoint = self.controller.ticks + 1, None
        while self._line and self._line[0][0] <= tick:
            setpoint = self._line.popleft()[1]
        self.controller.tick(setpoint, counts)
        return setpoint is not None

    def write(self) -> Any:
        """Returns the record of the present state."""
        self.writer.write(self.controller.ticks)
        return self.writer.record

    def forget(self) -> None:
        """Discards commands in transit, which are lost with their connection."""
        self._line.clear()

    def _stopped(self) -> bool:
        return inside(self.options.user_stop, self.world.time)

    def _draw(self, tick: int) -> float:
        block, row = divmod(tick, _BLOCK)
        if block != self._block:
            self._uniform = np.random.default_rng([*self._key, block]).random(_BLOCK).tolist()
            self._block = block
        return self._uniform[row]
