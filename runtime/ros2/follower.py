"""Follows a peer's trajectory: it sends its positions as setpoints of the profile, until it is stopped or replaced."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RequestError, SrlError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.messages import cdr
from srl.runtime.ros2.names import TRAJECTORY
from srl.runtime.ros2.trajectory import Trajectory

PERIOD: Final = 10_000_000  # ns between two setpoints
EARLY: Final = 10.0  # s, by which a trajectory may begin later


class Follower:
    """The trajectories of one setpoint.

    While the limb moves, the trajectory's end is held by further setpoints, as ros2_control does. A stop ends it: what
    is asked after a reset is asked anew.

    Attributes:
        able: whether the setpoint is of joints' positions.
    """

    def __init__(
        self, layout: Layout, name: str, send: Callable[[Array], None], report: Callable[[str], None]
    ) -> None:  # fmt: skip
        """
        Args:
            name: of the setpoint.
            send: sends its values (n,). Raises SrlError.
            report: takes what a person should know.
        """
        self._layout, self._name, self._send, self._report = layout, name, send, report
        field = layout.fields[name]
        self._names = field.labels
        self._place = f"trajectory of '{name}'"
        # The joints' own signals: where they were sent, and where they are.
        self._from = [
            other.name for role in ("sent", "state") for other in layout.fields.values()
            if other.role == role and other.labels == field.labels and other.unit == field.unit
            and other.name.removesuffix(".sent").rpartition(".")[2] in ("position", "position_command")
        ]  # fmt: skip
        self.able = len(field.shape) == 1 and len(self._names) == field.size > 0 and bool(self._from)
        self._limits = self._limits_of(field.size)
        self._lock = threading.Lock()
        self._trajectory: Trajectory | None = None
        self._row: NDArray[np.int64] | None = None
        self._start = self._due = self._stops = self._lost = 0
        self._active = 0  # CLOCK_MONOTONIC ns, since when the limb is seen to move without a break

    def _limits_of(self, size: int) -> tuple[Array, Array, Array]:
        """The guard's position and velocity limits, (n,) each; infinite where it has none."""
        fields, limits = self._layout.fields, self._layout.meta["limits"]
        alike = [name for name in limits if fields[name].labels == self._names and fields[name].unit in ("rad", "m")]
        found: dict[str, Any] = limits[alike[0]] if alike else {}

        def of(what: str, otherwise: float) -> Array:
            given = found.get(what)
            return np.full(size, otherwise) if given is None else np.asarray(given, float)

        return of("lower", -np.inf), of("upper", np.inf), of("velocity", np.inf)

    def take(self, payload: bytes, came: int, wall: int) -> None:
        """Begins with a trajectory, or says why it can't be.

        Args:
            payload: CDR.
            came: when it came, CLOCK_MONOTONIC ns.
            wall: Unix ns, now.
        """
        try:
            with self._lock:
                row, stops = self._row, self._stops
            if row is None or int(row[CYCLE.state]) != State.ACTIVE or came < self._active:
                raise RequestError(self._place, "the limb wasn't active when it came", "Start or reset it first")
            message = cdr.decode(TRAJECTORY, payload)
            stamp = message["header"]["stamp"]["sec"] * 1_000_000_000 + message["header"]["stamp"]["nanosec"]
            made = Trajectory(message, self._names, self._where(row), self._place)
            ahead = (stamp - wall) * 1e-9 if stamp else 0.0
            if not -made.end < ahead < EARLY:
                raise RequestError(self._place, f"it begins in {ahead:.1f} s", "Set header.stamp to 0: at once")
            made.check(*self._limits, self._names, self._place)
        except SrlError as error:
            self._report(str(error))
            return
        with self._lock:
            if self._stops == stops:  # else the limb has stopped meanwhile
                now = time.monotonic_ns()
                self._trajectory, self._start, self._due = made, now + round(ahead * 1e9), now

    def _where(self, row: NDArray[np.int64]) -> Array:
        """(n,): where the joints were sent last, else where they are. Raises RequestError."""
        for name in self._from:
            if np.isfinite(found := self._layout.value(row, name)).all():
                return found
        raise RequestError(self._place, "nobody knows where the joints are", "Wait until the device measures them")

    def cancel(self, why: str) -> None:
        """Ends it, if there is one; one that is looked at now doesn't begin."""
        with self._lock:
            self._stops += 1
            ended, self._trajectory = self._trajectory, None
        if ended is not None:
            self._report(f"{self._place} ends: {why}")

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
        with self._lock:
            if self._trajectory is None or now < self._due:
                return
            self._due = now + PERIOD
            values, _ = self._trajectory.at((now - self._start) * 1e-9)
        try:
            self._send(values)
        except SrlError as error:
            self.cancel(str(error))
