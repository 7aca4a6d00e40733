"""The wired system: parts with views into one row, as `srl.runtime.profile.wiring` builds it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.frames import Frames, Measured
from srl.runtime.contracts.signals import Array, Command, Stop
from srl.runtime.contracts.world import World
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.row import Row
from srl.runtime.profile.element import Element
from srl.runtime.profile.names import Link
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source
from srl.runtime.profile.transforms import Found

# Places among the row's float64 words, and the array of their values in another order. The index is made once, the
# array isn't part of the row.
Copy = tuple[NDArray[np.intp], Array]


@dataclass
class Cleared:
    """A command's clearance with its wires.

    Attributes:
        clearance: the judge.
        inputs: its wires, by input name.
        lag: s, and `tracking` (n,), as the profile says them.
        least_lag: s, as the profile says it.
        timeout: s, after which a velocity ends by itself; None for a position.
        period: s, as the profile says it; None: the command's.
        copies: what is taken from the row before it runs, because its order isn't the row's.
        devices: by input, the indices of the devices and clients behind it.
        computed: the inputs that laws compute: of no use while the laws don't run.
    """

    clearance: Clearance
    inputs: dict[str, Link]
    lag: float
    tracking: Array
    timeout: float | None = None
    least_lag: float = 0.0
    period: float | None = None
    copies: list[Copy] = field(default_factory=list)
    devices: dict[str, list[int]] = field(default_factory=dict)
    computed: frozenset[str] = frozenset()


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
    cleared: Cleared | None = None
    margin: Array | None = None  # (1,), that of the clearance


@dataclass
class Law:
    """A controller with its wires.

    Attributes:
        controller: the controller.
        inputs, outputs: the wires, by input and output name.
        reads: what is taken from the row before it runs, because its order isn't the row's.
        writes: what is put into the row after it has run.
        transforms: the transforms that it was given.
        measured: those of them that are computed before it runs.
    """

    controller: Controller
    inputs: dict[str, Link] = field(default_factory=dict)
    outputs: dict[str, Link] = field(default_factory=dict)
    reads: list[Copy] = field(default_factory=list)
    writes: list[Copy] = field(default_factory=list)
    transforms: tuple[Found, ...] = ()
    measured: list[Measured] = field(default_factory=list)


@dataclass
class MonitoredPose:
    """A pose that a law relies on, as its input or as that of a frame.

    Attributes:
        device: index of the device, or of the client, that gives it.
        pose: (7,), or (3,) of a mobile base.
        speed: m/s: a pose that moves faster isn't believed.
        client: it is given by a client, who may not have begun.
    """

    device: int
    pose: Array
    speed: float
    client: bool


@dataclass
class Graph:
    """The wired system."""

    profile: Profile
    source: Source
    layout: Layout
    row: Row
    devices: list[Driver]
    laws: list[Law]
    actuators: list[Actuator]
    world: World | None
    frames: Frames
    simulated: list[str]
    intent: list[bool]  # by device index (setpoint owners included): True if its loss is a loss of intent
    monitored_poses: list[MonitoredPose]
    warnings: list[str]  # what is probably wrong, a line each
    remarks: list[str]  # what a person should know of the simulated world and of the buses, a line each
    reads: list[Copy]  # measured values whose order isn't their command's, taken before the guards look at them

    @property
    def controllers(self) -> list[Controller]:
        """The controllers in their order."""
        return [law.controller for law in self.laws]

    def element(self, entry: Element) -> Array:
        """(1,), a view: the element that an emergency or reset input names."""
        labels = self.layout.fields[entry.signal].labels
        place = labels.index(entry.element) if entry.element is not None and labels else 0
        return self.row.views[entry.signal][place : place + 1]

    def followed(self, law: Law) -> int:
        """Index of the first sensor or client that the law follows, itself or by way of other laws; -1: none."""
        laws, left, known = {each.controller.name: each for each in self.laws}, [law], set[str]()
        while left:
            names = [name.partition(".")[0] for wire in left.pop(0).inputs.values() for name in wire.far]
            for owner in dict.fromkeys(names):
                if owner in self.layout.devices and self.intent[found := self.layout.devices.index(owner)]:
                    return found
                if owner in laws and owner not in known:
                    known.add(owner)
                    left.append(laws[owner])
        return -1

    def actuators_of(self, device: int) -> list[Actuator]:
        """The commands of the device at this index; none for a sensor."""
        return [a for a in self.actuators if a.device == device]

    @property
    def clearances(self) -> dict[str, Cleared]:
        """By command, in the profile's `guard:`."""
        return {a.name: a.cleared for a in self.actuators if a.cleared is not None}
