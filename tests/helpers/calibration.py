"""A profile with the law `ikns`, and a person made of formulas who follows a calibration's instructions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from srl.commissioning.calibration.ikns.channel_map import ChannelMap, channel_map
from srl.commissioning.calibration.ikns.procedure import Plan, Procedure
from srl.commissioning.calibration.ikns.steps import Kind, Step
from srl.commissioning.calibration.profile_subset import build, subset
from srl.commissioning.calibration.sources import Rows, RowSource
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.row import Row
from srl.runtime.profile import profile

# A finger on the forearm, a pedal that stops it, and all that nobody needs for a calibration.
PROFILE = """
name: worn-finger
rate: 100
start: manual
clock: monotonic
devices:
  mocap:
    driver: vicon
    port: tcp://192.168.10.1:801
    frame: room
    markers: {clav: wearer/CLAV, c7: wearer/C7, strn: wearer/STRN, t10: wearer/T10, rsho: wearer/RSHO,
              rupa: wearer/RUPA, relb: wearer/RELB, rfrm: wearer/RFRM, rwra: wearer/RWRA, rwrb: wearer/RWRB,
              rfin: wearer/RFIN}
  ring: {driver: ring, port: /dev/ttyUSB7}
  finger:
    driver: firmata
    port: /dev/ttyACM0
    servos:
      abduction: {pin: 9, lower: -1.571, upper: 1.571, home: 0.0}
      flexion_1: {pin: 10, lower: -1.571, upper: 1.571, home: 0.1}
      flexion_2: {pin: 11, lower: -1.571, upper: 1.571, home: 0.1}
      flexion_3: {pin: 6, lower: -1.571, upper: 1.571, home: 0.1}
controllers:
  - use: arm-angles
    name: arm
    chest: chest
    in: {markers: mocap.markers, marker_visible: mocap.marker_visible}
  - use: ikns
    name: null-space
    calibration: p07.json
    in: {angles: arm.angles, held: arm.held, hand: arm.hand}
  - use: finger-closure
    name: closure
    open: {abduction: 0.0, flexion_1: 0.1, flexion_2: 0.1, flexion_3: 0.1}
    closed: {abduction: 0.0, flexion_1: 0.7, flexion_2: 0.9, flexion_3: 0.7}
    in: {c: null-space.c, c_rate: null-space.c_rate}
    out: {q: finger.position_command, q_velocity: finger.position_command.velocity}
guard:
  finger.position_command: {lower: -1.0, upper: 1.0, velocity: 4.0, acceleration: 40.0}
stop: {finger: hold}
faults: {intent-loss: hold}
emergency: [{signal: ring.buttons, element: button}]
models:
  body: {kind: body, stature: 1.75, sides: [right]}
  finger: {kind: finger}
frames:
  room: {}
  chest: {parent: room, pose: arm.chest}
sim:
  world: cell
  ends_with: wearer
  devices: {finger: {}}
  parts:
    wearer: {part: upper-body, at: {parent: room, position: [0.0, 0.0, 1.1]}}
bus: {decimate: 10}
record: {plots: [{title: c, unit: "1", lines: {c: null-space.c}}]}
"""
QUICK = Plan(static=0.5, exploration=4.0, trial=1.5, settle=0.3, patience=3.0)
FEW = Thresholds(samples=60)

MIDDLE = np.array([0.30, -0.18, -0.15])  # m, of the workspace
SIZE = np.array([0.12, 0.13, 0.11])  # m, from there to its sides


@dataclass
class Person:
    """What a person does otherwise than asked. Points are counted from 1.

    Attributes:
        wander: m, by point: how far the hand goes to and fro in the trial.
        swing: rad, by point: the DoF's range, instead of 1.
        hidden: points at which markers are missing.
        flat: the hand stays at one height.
        deaf: doesn't go to the points at all.
    """

    wander: dict[int, float] = field(default_factory=dict)
    swing: dict[int, float] = field(default_factory=dict)
    hidden: set[int] = field(default_factory=set)
    flat: bool = False
    deaf: bool = False


class Actor(RowSource):
    """Rows of a person whose joint angles are formulas of where the hand is and of the DoFs.

    Angles are affine in the hand's position, plus each DoF times a direction that turns a little over the workspace.

    Attributes:
        person: what isn't as asked; may be changed.
        rows: all rows so far.
    """

    channel_map: ChannelMap

    def __init__(self, dofs: tuple[str, ...] = ("swivel",), person: Person | None = None) -> None:
        made = subset(*profile.parse("worn-finger.yaml", PROFILE), "P07", dofs, FEW)
        self.graph = build(*made, sim=False)
        self.graph.layout.meta["wall"] = 1_700_000_000_000_000_000
        self.graph.layout.meta["simulated"] = ["mocap"]  # it stands for the simulated wearer
        self.channel_map = channel_map(self.graph.layout, "worn-finger.yaml")
        self.person = person or Person()
        self.rows: list[Rows] = []
        self._step, self._procedure = Step(Kind.STATIC), Procedure(dofs)
        self._row: Row = self.graph.row
        self._t = self._started = 0
        self._hand = MIDDLE.copy()
        self.closed = False
        rng = np.random.default_rng(5)
        n = len(self.channel_map.joints)
        self._posture, self._by_hand = rng.normal(size=n), rng.normal(size=(n, 3))
        self._along = np.linalg.qr(rng.normal(size=(n, n)))[0][: len(dofs)]
        self._turn = 0.3 * rng.normal(size=(len(dofs), n, 3))

    def take(self) -> Rows:
        made = np.array([self._next() for _ in range(10)])
        self.rows.append(made)
        return made

    def begin(self, procedure: Any) -> None:
        self._row.views[self.channel_map.parameter][()] = procedure.step.mark
        self._step, self._procedure, self._started = procedure.step, procedure, self._t

    def close(self) -> None:
        self.closed = True

    def _next(self) -> Array:
        self._t += 1
        t, person, number = (self._t - self._started) / 100.0, self.person, self._step.point + 1
        hand = self._go(t)
        dofs = np.zeros(len(self._along))
        if self._step.kind is Kind.TRIAL:
            dofs[self._step.dof] = 0.5 * person.swing.get(number, 1.0) * np.sin(2.0 * np.pi * t / 1.5)
            hand = hand + np.array([0.0, person.wander.get(number, 0.0) * np.sin(12.0 * t), 0.0])
        directions = self._along + self._turn @ (hand - MIDDLE)
        views, ints = self._row.views, self._row.ints
        views["arm.angles"][:] = self._posture + self._by_hand @ hand + dofs @ directions
        views["arm.hand"][:3] = hand
        views["arm.held"][:] = number in person.hidden and self._step.kind is Kind.TRIAL
        ints[CYCLE.cycle], ints[CYCLE.now], ints[CYCLE.state] = self._t, self._t * 10_000_000, State.ACTIVE
        return self._row.words.copy()

    def _go(self, t: float) -> Array:
        target = self._procedure.target
        goal = MIDDLE if target is None or self.person.deaf else target
        if self._step.kind is Kind.EXPLORATION:
            goal = MIDDLE + SIZE * np.sin(2.0 * np.pi * np.array([1.0, 1.5, 0.5]) * t / 2.0)
            self._hand = goal
        if self.person.flat and self._step.kind is not Kind.EXPLORATION:
            goal = np.array([goal[0], goal[1], MIDDLE[2]])
        gap = goal - self._hand
        self._hand = self._hand + gap * min(1.0, 0.01 / max(float(np.linalg.norm(gap)), 1e-9))
        return self._hand
