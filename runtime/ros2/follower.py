"""Follows a peer's trajectory: it sends its positions as setpoints of the profile, until it is stopped or replaced."""

from __future__ import annotations

import threading
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
        self._start = self._due = 0

    def _limits_of(self, size: int) -> tuple[Array, Array, Array]:
        """The guard's position and velocity limits, (n,) each; infinite where it has none."""
        fields, limits = self._layout.fields, self._layout.meta["limits"]
        alike = [name for name in limits if fields[name].labels == self._names and fields[name].unit in ("rad", "m")]
        found: dict[str, Any] = limits[alike[0]] if alike else {}

        def of(what: str, otherwise: float) -> Array:
            given = found.get(what)
            return np.full(size, otherwise) if given is None else np.asarray(given, float)

        return of("lower", -np.inf), of("upper", np.inf), of("velocity", np.inf)

    def take(self, payload: bytes, row: NDArray[np.int64], wall: int, now: int) -> None:
        """Begins with a trajectory, or says why it can't be. wall: Unix ns; now: CLOCK_MONOTONIC ns."""
        try:
            if int(row[CYCLE.state]) != State.ACTIVE:
                raise RequestError(self._place, "the limb isn't active", "Start or reset it first")
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
            self._trajectory, self._start, self._due = made, now + round(ahead * 1e9), now

    def _where(self, row: NDArray[np.int64]) -> Array:
        """(n,): where the joints were sent last, else where they are. Raises RequestError."""
        for name in self._from:
            if np.isfinite(found := self._layout.value(row, name)).all():
                return found
        raise RequestError(self._place, "nobody knows where the joints are", "Wait until the device measures them")

    def cancel(self, why: str) -> None:
        """Ends it, if there is one."""
        with self._lock:
            if self._trajectory is not None:
                self._trajectory = None
                self._report(f"{self._place} ends: {why}")

    def turn(self, row: NDArray[np.int64] | None, now: int) -> None:
        """Sends the next setpoint, when it is due. now: CLOCK_MONOTONIC ns."""
        if self._trajectory is None or row is None:
            return
        if (state := State(int(row[CYCLE.state]))) is not State.ACTIVE:
            self.cancel(f"the limb is {state.name.lower()}")
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
