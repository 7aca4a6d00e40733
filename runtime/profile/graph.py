"""The wired system: parts with views into one row, as `runtime.profile.wiring` builds it."""

from __future__ import annotations

from dataclasses import dataclass

from runtime.contracts.controller import Controller
from runtime.contracts.driver import Driver
from runtime.contracts.frames import Frames
from runtime.contracts.signals import Array, Command, Signal, Stop
from runtime.contracts.world import World
from runtime.ipc.layout import Layout
from runtime.ipc.row import Row
from runtime.profile.profile import Profile, Source


@dataclass
class Actuator:
    """One command signal: its device, the desired command, and the arrays for the guard."""

    name: str  # "finger.position_command"
    device: int  # index into the graph's devices
    command: Command
    asked: Array
    asked_velocity: Array | None
    gravity: Array | None  # the gravity compensation that a torque contains, if a controller gives it
    applied: Array
    sent: Array
    measured: Array | None
    measured_velocity: Array | None
    category: Stop
    home: Array | None


@dataclass
class Graph:
    """The wired system."""

    profile: Profile
    source: Source
    layout: Layout
    row: Row
    devices: list[Driver]
    controllers: list[Controller]
    actuators: list[Actuator]
    world: World | None
    frames: Frames
    simulated: list[str]
    intent: list[bool]  # by device index (setpoint owners included): True if its loss is a loss of intent

    def actuators_of(self, device: int) -> list[Actuator]:
        """The commands of the device at this index; none for a sensor."""
        return [a for a in self.actuators if a.device == device]

    def wiring(self) -> list[tuple[str, str, str]]:
        """(from, signal, to) of every connection, for `srl check`."""
        rows = []
        for controller, entry in zip(self.controllers, self.profile.controllers, strict=True):
            for signal in controller.inputs:
                rows.append((entry.inputs[signal.name], form(signal), f"{controller.name}.{signal.name}"))
            for signal in controller.outputs:
                target = entry.outputs.get(signal.name, f"{controller.name}.{signal.name}")
                rows.append((f"{controller.name}.{signal.name}", form(signal), target))
        return rows


def form(signal: Signal) -> str:
    """Shape, unit and frame of a signal as text: "5x3 m in hand"."""
    shape = "x".join(map(str, signal.shape))
    return f"{shape} {signal.unit}" + (f" in {signal.frame}" if signal.frame else "")
