"""Follows a peer's trajectory: it sends its positions as setpoints of the profile, until it is stopped or replaced."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RequestError, SrlError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.ros2.names import TRAJECTORY
from srl.runtime.ros2.trajectory import Trajectory

PERIOD: Final = 10_000_000  # ns between two setpoints
LONGEST_STEP: Final = 0.03  # s of the trajectory between two setpoints: a node that was held up goes on where it was
EARLY: Final = 10.0  # s, by which a trajectory may begin later
LATE: Final = 0.05  # s, ago that it may have begun: more would be a jump into it
SLOWING: Final = 0.3  # s, at least, in which a trajectory that a peer cancels comes to rest on its own way
RESTS: Final = 1e-4  # rad or m between two setpoints: joints that are sent less far stand still


class Pursuit(Protocol):
    """Who asked for a trajectory and wants to know how it goes: an action's goal."""

    def judge(self, at: float, end: float, index: int, desired: Array, actual: Array) -> bool: ...

    def cancelled(self) -> None: ...

    def aborted(self, why: str) -> None: ...


@dataclass
class Motion:
    """A trajectory on its way.

    Attributes:
        trajectory: which.
        goal: who wants to know; None: nobody, or not any more.
        time: s along it; below 0: it is yet to begin.
        turned: CLOCK_MONOTONIC ns, when `time` was set.
        pace: of `time`, 1; it falls to 0 once the goal is cancelled.
        held: the goal is cancelled.
        hold: (n,) where the joints are held instead, once a tolerance was violated.
        sent: (n,) where the joints were sent at the last turn.
    """

    trajectory: Trajectory
    goal: Pursuit | None
    time: float
    turned: int
    pace: float = 1.0
    held: bool = False
    hold: Array | None = None
    sent: Array | None = None


class Follower:
    """The trajectories of one setpoint.

    While the limb moves, the trajectory's end is held by further setpoints, as ros2_control does. A stop ends it: what
    is asked after a reset is asked anew.

    Attributes:
        names: of the joints.
        able: whether the setpoint moves the joints of one device, position by position.
        measured: whether the device measures their position and velocity.
    """

    def __init__(
        self, layout: Layout, name: str, send: Callable[[Array], None], report: Callable[[str], None],
        partial: bool = False,
    ) -> None:  # fmt: skip
        """
        Args:
            name: of the setpoint.
            send: sends its values (n,). Raises SrlError.
            report: takes what a person should know.
            partial: whether a trajectory may leave joints out, which then stay where they are.
        """
        self._layout, self._name, self._send, self._report, self._partial = layout, name, send, report, partial
        field = layout.fields[name]
        self.names = field.labels
        self._place = f"trajectory of '{name}'"
        entry: dict[str, Any] = next((each for each in layout.meta["setpoints"] if each["name"] == name), {})
        command = entry.get("moves") or ""
        self.able = bool(command) and len(field.shape) == 1 and field.unit in ("rad", "m")
        device = command.partition(".")[0]
        # The device's own signals: where its joints were sent, and what it measures.
        self._sent = self._own(f"{command}.sent")
        self.able = self._sent is not None
        self._actual = [self._own(f"{device}.position"), self._own(f"{device}.velocity")]
        self.measured = [each is not None for each in self._actual]
        self._limits, self._slowing = self._limits_of(command)
        self._lock = threading.Lock()
        self._motion: Motion | None = None
        self._row: NDArray[np.int64] | None = None
        self._stops = self._lost = self._due = 0
        self._active = 0  # CLOCK_MONOTONIC ns, since when the limb is seen to move without a break

    def _own(self, name: str) -> tuple[Field, NDArray[np.intp]] | None:
        """A signal of the same joints, and where each of them is in it; None if there is none."""
        field = self._layout.fields.get(name)
        if field is None or not self.able or not set(self.names) <= set(field.labels):
            return None
        return field, np.array([field.labels.index(joint) for joint in self.names])

    def _read(self, own: tuple[Field, NDArray[np.intp]] | None, row: NDArray[np.int64]) -> Array:
        """(n,) of a row; NaN where there is none."""
        if own is None:
            return np.full(len(self.names), np.nan)
        values: Array = self._layout.value(row, own[0].name)[own[1]]
        return values

    def _limits_of(self, command: str) -> tuple[tuple[Array, Array, Array], float]:
        """The guard's position and velocity limits, (n,) each and infinite where it has none; s to come to rest."""
        given: dict[str, Any] = self._layout.meta["limits"].get(command, {})
        own = self._own(command)

        def of(what: str, otherwise: float) -> Array:
            values = given.get(what)
            n = len(self.names)
            if values is None or own is None:
                return np.full(n, otherwise)
            return np.asarray(values, float)[own[1]]

        velocity, acceleration = of("velocity", np.inf), of("acceleration", np.inf)
        known = np.isfinite(velocity) & np.isfinite(acceleration)
        stop = velocity[known] / acceleration[known]
        return (of("lower", -np.inf), of("upper", np.inf), velocity), max(SLOWING, float(stop.max(initial=0.0)))

    def take(self, payload: bytes, came: int) -> None:
        """Begins with a trajectory, or says why it can't be.

        Args:
            payload: CDR.
            came: when it came, CLOCK_MONOTONIC ns.
        """
        try:
            self.begin(cdr.decode(TRAJECTORY, payload), came)
        except SrlError as error:
            self._report(str(error))

    def begin(self, message: dict[str, Any], came: int, goal: Pursuit | None = None) -> None:
        """Begins with a trajectory; the one before ends.

        Args:
            message: the decoded trajectory_msgs/msg/JointTrajectory.
            came: when it came, CLOCK_MONOTONIC ns.
            goal: who wants to know how it goes.
        Raises:
            RequestError: it can't be followed.
        """
        with self._lock:
            row, stops = self._row, self._stops
        if row is None or int(row[CYCLE.state]) != State.ACTIVE or came < self._active:
            raise RequestError(self._place, "the limb wasn't active when it came", "Start or reset it first")
        stamp = message["header"]["stamp"]["sec"] * 1_000_000_000 + message["header"]["stamp"]["nanosec"]
        made = Trajectory(message, self.names, self._where(row), self._place, self._partial)
        ahead = (stamp - time.time_ns()) * 1e-9 if stamp else 0.0
        if not -LATE < ahead < EARLY:
            raise RequestError(self._place, f"it begins in {ahead:.2f} s", "Set header.stamp to 0: at once")
        made.check(*self._limits, self.names, self._place)
        with self._lock:
            if self._stops != stops:
                raise RequestError(self._place, "the limb has stopped meanwhile, or another command came", "Ask again")
            now = time.monotonic_ns()
            before, self._motion = self._motion, Motion(made, goal, -max(ahead, 0.0), now)
            self._due = now
        if before is not None and before.goal is not None:
            before.goal.aborted("another trajectory came")

    def _where(self, row: NDArray[np.int64]) -> Array:
        """(n,): where the joints were sent last, else where they are. Raises RequestError."""
        for own in (self._sent, self._actual[0]):
            if np.isfinite(found := self._read(own, row)).all():
                return found
        raise RequestError(self._place, "nobody knows where the joints are", "Wait until the device measures them")

    def where(self) -> Array | None:
        """(n,): where the joints were sent last; None where nobody knows."""
        with self._lock:
            row = self._row
        try:
            return None if row is None else self._where(row)
        except RequestError:
            return None

    def hold(self, goal: Pursuit) -> None:
        """A peer cancels its goal: the joints come to rest on their way and stay there."""
        with self._lock:
            if self._motion is not None and self._motion.goal is goal:
                self._motion.held = True

    def cancel(self, why: str) -> None:
        """Ends the trajectory, if there is one; one that is looked at now doesn't begin."""
        with self._lock:
            self._stops += 1
            ended, self._motion = self._motion, None
        if ended is not None:
            self._report(f"{self._place} ends: {why}")
            if ended.goal is not None:
                ended.goal.aborted(why)

    def turn(self, rows: NDArray[np.int64], row: NDArray[np.int64] | None, lost: int, now: int) -> None:
        """Sends the next setpoint, when it is due.

        Args:
            rows: (k, width), new since the last turn: each of them must be of a limb that moves.
            row: the newest.
            lost: rows that nobody has read, so far: what the limb did then isn't known.
            now: CLOCK_MONOTONIC ns.
        """
        states = rows[:, CYCLE.state]
        stopped, unknown = bool((states != State.ACTIVE).any()), lost != self._lost
        with self._lock:
            self._row, self._lost = row, lost
            if stopped or unknown:
                self._active = now
        if stopped or unknown:
            state = State(int(states[states != State.ACTIVE][-1])).name.lower() if stopped else "not known"
            self.cancel(f"the limb's state is {state}" if unknown else f"the limb is {state}")
            return
        # All at once: a command that ends the motion comes before this setpoint, or after it.
        with self._lock:
            motion = self._motion
            if motion is None or now < self._due:
                return
            self._due = now + PERIOD
            self._go_on(motion, now)
            if row is not None and len(rows):
                self._judge(motion, row, now)
            values = motion.trajectory.at(motion.time)[0] if motion.hold is None else motion.hold
            try:
                self._send(values)
                return
            except SrlError as error:
                problem = str(error)
        self.cancel(problem)

    def _go_on(self, motion: Motion, now: int) -> None:
        """Moves the time along the trajectory on; held, its pace falls to nothing."""
        step = min((now - motion.turned) * 1e-9, LONGEST_STEP)
        motion.turned = now
        slower = min(step / self._slowing, motion.pace) if motion.held else 0.0
        motion.time += step * (motion.pace - slower / 2)
        motion.pace -= slower

    def _judge(self, motion: Motion, row: NDArray[np.int64], now: int) -> None:
        """Compares what was asked for when the newest sample was taken with that sample."""
        goal, sent = motion.goal, self._read(self._sent, row)
        before, motion.sent = motion.sent, sent
        if goal is None:
            return
        if motion.held and motion.pace <= 0.0:
            if before is None or not np.abs(sent - before).max() > RESTS:
                motion.goal = None
                goal.cancelled()
            return
        own = self._actual[0]
        taken = int(row[CYCLE.now if own is None else self._layout.stamped_by(own[0])])
        at = motion.time - max(now - taken, 0) * 1e-9 * motion.pace
        actual = np.array([self._read(each, row) for each in self._actual])
        trajectory = motion.trajectory
        if goal.judge(at, trajectory.end, trajectory.index(at), np.array(trajectory.at(at)), actual):
            return
        # Beyond a tolerance the joints stay where they are: what holds them up isn't pressed on.
        motion.goal = None
        motion.hold = actual[0] if np.isfinite(actual[0]).all() else self._where(row)
