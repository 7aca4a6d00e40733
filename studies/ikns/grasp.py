"""One trial of the grasping experiment: pick, lift, place and release an object (Lisini Baldi et al. 2023, III-C).

Whoever does it is behind `Grasper`: an ideal carrier here, a simulated wearer or a person in a study. The hand comes
from the side, its palm vertical, with the little finger down; the object is pressed between the worn finger and palm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import acos, cos, hypot, inf, sin
from typing import Final, Literal, Protocol

import numpy as np

from srl.runtime.contracts.rotation import Pose, Vector, conjugate, product, turned
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED
from srl.runtime.loop.lockstep import Lockstep
from srl.sim.parts.body.carrier import CarrierPart
from srl.sim.parts.hand.passive_hand import PALM_FACE
from srl.sim.parts.hand.ycb import Ycb
from srl.sim.parts.things.table import MARK
from srl.studies.ikns.published import LIMIT
from srl.studies.simulated import cell

Reason = Literal["", "not lifted", "dropped", "not released", "off the goal", "out of time"]

_SIDE: Final = (0.5, 0.5, 0.5, -0.5)  # hand in the world: distal along x, palm to the left, little finger down
_FINGER_FACE: Final = -0.012  # m, distal, of the straight finger's inner face: its axis is at -20 mm, 16 mm thick
_GAP: Final = 0.010  # m between object and straight finger, when the palm comes near; ours
_NEAR: Final = 0.004  # m between object and palm; ours
_LOWEST: Final = 0.040  # m, of the hand's middle above the table: the edge of the hand is 33 mm below it
_HIGHEST: Final = 0.150  # m: nobody takes the chips can at its top
_SUNK: Final = 0.25  # share of the lift below which an object that was lifted counts as dropped; ours
_CLOSING: Final = 1.0  # s, of an ideal grasper's control value for its whole range; ours
ASIDE: Final = 0.15  # m that the hand begins and ends to the side


class Grasper(Protocol):
    """Who grasps: takes the hand to places, and wishes the finger open or closed."""

    def reach(self, wrist: Pose, seconds: float) -> None:
        """Begins to take the hand's frame to a pose in the world, x y z (m), w x y z, in about this time."""

    @property
    def arrived(self) -> bool:
        """Whether the hand is there."""

    def squeeze(self, c: float) -> None:
        """Begins to bring the control value to c."""

    @property
    def squeezed(self) -> bool:
        """Whether the control value is there."""


@dataclass(frozen=True)
class Task:
    """What is to be done. Positions are on the table, m.

    Attributes:
        lift: m above the table.
        heading: rad, of the forearm where the object is taken, from x to y.
        turn: rad, by which it is turned further where the object is placed.
        miss: m, how far off the hand takes the object, in the world.
        clear: m, by which the palm stops farther from the object than an ideal one.
        squeeze: how far the finger is closed, 0 to 1.
        behind: how far the hand comes from behind, as a share of how far it comes from the side.
        pace: s of each motion of the hand; ours, as fast as people reach without hurry.
    """

    start: tuple[float, float]
    goal: tuple[float, float]
    table: float = 0.0
    lift: float = 0.10
    heading: float = 0.0
    turn: float = 0.0
    miss: Vector = (0.0, 0.0, 0.0)
    clear: float = 0.0
    squeeze: float = 1.0
    behind: float = 0.0
    pace: float = 0.8


@dataclass(frozen=True)
class Grasp:
    """What came of it.

    Attributes:
        seconds: from the beginning to the release; until the failure, if it failed.
        slip: m, the farthest that the object moved in the hand while it was carried.
        tilt: rad, of the object at the end, from how it stood.
        off: m, from the goal at the end.
        force: N, the greatest sum of contact forces on the finger while it carried.
    """

    success: bool
    reason: Reason
    seconds: float
    slip: float
    tilt: float
    off: float
    force: float


class _FailureError(Exception):
    def __init__(self, reason: Reason) -> None:
        self.reason = reason


def grip(thing: Ycb, clear: float = 0.0) -> Vector:
    """Where the middle of an object is in the hand's frame when the palm has come to it but for `clear`, m."""
    across = thing.size[0] / 2  # along the hand; from the palm outwards a box has another width
    deep = thing.size[1] / 2 if thing.shape == "box" else across
    height = min(max(thing.height / 2 + thing.centre, _LOWEST), _HIGHEST)
    return (height - thing.height / 2, _FINGER_FACE + _GAP + across, -(PALM_FACE + _NEAR + clear + deep))


def wrist(task: Task, thing: Ycb, place: tuple[float, float], up: float = 0.0, aside: float = 0.0) -> Pose:
    """Where the hand's frame is when it has the object at a place, so far above the table and to the side, m."""
    half = (task.heading + (task.turn if place == task.goal else 0.0)) / 2
    heading = (cos(half), 0.0, 0.0, sin(half))
    turn = product(heading, _SIDE)
    dx, dy, dz = turned(turn, grip(thing, task.clear))
    sx, sy, _ = turned(heading, (-aside * task.behind, -aside, 0.0))
    x, y, z = place[0] - dx + sx, place[1] - dy + sy, task.table + thing.height / 2 - dz + up
    mx, my, mz = task.miss
    return (x + mx, y + my, z + mz, *turn)


def grasp_trial(
    lockstep: Lockstep,
    grasper: Grasper,
    task: Task,
    thing: Ycb,
    *,
    part: str = "thing",
    finger: str = "finger",
    hand: str = "hand",
    watch: Callable[[], None] = lambda: None,
) -> Grasp:
    """Does one trial. The object stands at the start, the finger is open.

    Success is the paper's: not dropped, and done in 20 s; and the object is left on the goal's mark.

    Args:
        part, finger, hand: names of the cell's parts: the object, the robotic finger, and the hand's frame.
        watch: called after every step, for recording.
    """
    trial = _Trial(lockstep, grasper, task, thing, part, finger, hand, watch)
    try:
        trial.run()
        reason: Reason = ""
    except _FailureError as failure:
        reason = failure.reason
    return trial.result(reason)


class _Trial:
    def __init__(
        self,
        lockstep: Lockstep,
        grasper: Grasper,
        task: Task,
        thing: Ycb,
        part: str,
        finger: str,
        hand: str,
        watch: Callable[[], None],
    ) -> None:
        world = cell(lockstep)
        self._lockstep, self._grasper, self._task, self._thing = lockstep, grasper, task, thing
        self._world, self._hand, self._watch = world, hand, watch
        self._pose: Array = world.truth_arrays[f"{part}_pose"]
        self._contact: Array = world.truth_arrays[f"{finger}_contact"]
        self._began, self._done = world.time, 0
        self._held: Array | None = None  # m, of the object in the hand when it was lifted
        self._slip = self._force = 0.0
        self._floor = -inf  # m, height below which the object is lost

    def run(self) -> None:
        task, take = self._task, self._grasper
        self._reach(task.start, aside=ASIDE)
        self._reach(task.start)
        take.squeeze(task.squeeze)
        self._until(lambda: take.squeezed)
        stood, self._held = float(self._pose[2]), self._inside()
        self._reach(task.start, up=task.lift)
        if self._pose[2] - stood < task.lift / 2:
            raise _FailureError("not lifted")
        self._floor = stood + _SUNK * task.lift
        self._reach(task.goal, up=task.lift)
        self._floor = -inf
        self._reach(task.goal)
        self._held = None
        take.squeeze(0.0)
        self._until(lambda: take.squeezed and self._contact[0] == 0.0, failure="not released")
        self._done = self._world.time
        left, hand = self._pose[:3].copy(), self._place()
        self._reach(task.goal, aside=ASIDE)
        if np.linalg.norm(self._pose[:3] - left) > np.linalg.norm(self._place() - hand) / 2:  # it went with the hand
            raise _FailureError("not released")
        if self._off() > MARK:
            raise _FailureError("off the goal")

    def result(self, reason: Reason) -> Grasp:
        end = self._done if self._done and not reason else self._world.time
        _, x, y, _ = self._pose[3:].tolist()
        tilt = acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0))
        tilt = 0.0 if self._thing.shape == "sphere" else tilt
        return Grasp(not reason, reason, (end - self._began) * 1e-9, self._slip, tilt, self._off(), self._force)

    def _reach(self, place: tuple[float, float], up: float = 0.0, aside: float = 0.0) -> None:
        self._grasper.reach(wrist(self._task, self._thing, place, up, aside), self._task.pace)
        self._until(lambda: self._grasper.arrived)

    def _until(self, reached: Callable[[], bool], failure: Reason = "out of time") -> None:
        """Steps until it is reached, the object is lost, or the time is over."""
        first = True
        while first or not reached():
            first = False
            self._lockstep.step()
            self._watch()
            if self._held is not None:
                self._slip = max(self._slip, float(np.linalg.norm(self._inside() - self._held)))
                self._force = max(self._force, float(self._contact[0]))
            if self._pose[2] < self._floor:
                raise _FailureError("dropped")
            if not self._done and self._world.time - self._began > LIMIT * 1e9:
                raise _FailureError(failure)

    def _inside(self) -> Array:
        """(3,) m, the object's middle in the hand's frame."""
        hand = self._world.pose_of(self._hand)
        x, y, z = (self._pose[:3] - hand[:3]).tolist()
        return np.array(turned(conjugate(hand[3:]), (x, y, z)))

    def _place(self) -> Array:
        """(3,) m, the hand's frame in the world."""
        return np.array(self._world.pose_of(self._hand)[:3])

    def _off(self) -> float:
        """m, from the goal."""
        x, y = self._task.goal
        return hypot(float(self._pose[0]) - x, float(self._pose[1]) - y)


class Carried:
    """An ideal grasper: the part `carrier` takes the hand.

    The control value goes evenly to what is wished: the client that sends a setpoint of the profile, every cycle.
    """

    def __init__(self, lockstep: Lockstep, part: str, c: str) -> None:
        """Args:
        part: the carrier's name.
        c: the setpoint's name, CLIENT.NAME; that of its rate is with `_rate`.
        """
        world = cell(lockstep)
        self._carrier = world.part(CarrierPart, part)
        self._c, self._c_rate = (lockstep.graph.row.views[name] for name in (c, f"{c}_rate"))
        self._dt = lockstep.period * 1e-9
        self._step, self._wish = self._dt / _CLOSING, 0.0
        self._c[0] = self._c_rate[0] = 0.0
        self._lockstep = lockstep
        row = lockstep.graph.row
        self._words = row.devices[row.layout.devices.index(c.partition(".")[0])]
        self._words[DEVICE.link] |= LINK_CONNECTED

    def reach(self, wrist: Pose, seconds: float) -> None:
        """Begins to take the hand there."""
        self._carrier.go(wrist, seconds)

    @property
    def arrived(self) -> bool:
        """Whether the hand is there."""
        return self._carrier.there

    def squeeze(self, c: float) -> None:
        """Begins to bring the control value to c."""
        self._wish = c

    @property
    def squeezed(self) -> bool:
        """Whether the control value is there."""
        return bool(self._c[0] == self._wish)

    def watch(self) -> None:
        """Moves the control value by one cycle: give it to the trial as `watch`."""
        step = min(max(self._wish - self._c.item(), -self._step), self._step)
        self._c[0] += step
        if abs(self._c.item() - self._wish) < 1e-9:
            self._c[0] = self._wish
        self._c_rate[0] = step / self._dt
        self._words[DEVICE.stamp] = self._lockstep.count * self._lockstep.period
