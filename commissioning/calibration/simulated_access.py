"""The simulated servos of a cut profile, and a simulated person who moves them with keys as `srl jog` takes them.

The person sees the joints themselves (`Fake.looks`), not what the device was told, and doesn't know which key moves a
joint which way.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.commissioning.calibration.servos.procedure import Procedure
from srl.commissioning.calibration.sources import RowFile, Rows, Stepped, Tap
from srl.commissioning.jog.hold import FINE, PAUSE, Hold
from srl.commissioning.jog.profile_subset import PRESS, WAY, ProfileSubset
from srl.commissioning.jog.session import FRESH
from srl.control.setpoint.jog import HOLD, REST
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Drive
from srl.runtime.contracts.world import Fake
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED

_REPEAT: Final = 0.033  # s between repeats of a held key
_NEAR: Final = 0.04  # rad, from where on the fine keys are used
_TAPS: Final = 0.015  # rad, from where on a fine key is tapped, and the eyes wait
_AFTER: Final = 0.3  # s for which they do
_THERE: Final = 0.004  # rad, to which a hobby servo's dead band lets a joint be brought
_LOOKS: Final = 0.6  # s without a key after which the person is sure of what is seen
_WRONG: Final = 0.02  # rad, by which it must go the wrong way to be seen
_TIMEOUT: Final = 90.0  # s, for one angle


class SimulatedDrive(Stepped):
    """The simulated servos and the person."""

    def __init__(
        self, subset: ProfileSubset, tap: Tap[Any], report: Callable[[str], None], record: Path | None = None
    ) -> None:
        """Raises SrlError: the system can't be built, or its simulated joints can't be seen."""
        subset.graph.layout.meta["wall"] = time.time_ns()
        super().__init__(subset.graph, tap, subset.source.label, report)
        self._period = 1.0 / float(subset.profile.rate)
        self._hold = Hold(tuple(subset.speed), max(FRESH, 1.5 * self._period))
        least = HOLD * FINE * max(subset.speed.values())  # rad, that a joint moves at least
        self._person = _Person(self._hold, max(_THERE, 0.6 * least))
        self._fake = self._graph.devices[subset.actuator.device]
        self._applied: Array = subset.actuator.applied
        row = self._graph.row
        self._terminal = row.devices[self._graph.layout.devices.index("terminal")]
        self._terminal[DEVICE.link] = LINK_CONNECTED
        self._procedure: Procedure | None = None
        self._place = subset.source.place("sim")
        self._file = None if record is None else RowFile(self._graph.layout, record)
        self._looks()

    def take(self) -> Rows:
        rows = np.empty((self._count, self._graph.layout.width), np.int64)
        row = self._graph.row
        for each in rows:
            now = (self._lockstep.count + 1) * self._period
            row.views[WAY][:], row.views[PRESS][:] = self._hold.at(now)
            self._terminal[DEVICE.stamp] = (self._lockstep.count + 1) * self._lockstep.period
            self._lockstep.step()
            each[:] = row.words
            self._move(now)
        if self._file is not None:
            self._file.add(rows)
        return rows

    def begin(self, procedure: Any) -> None:
        self._procedure = procedure
        now = self._lockstep.count * self._period
        self.mark(procedure)
        self._hold.guide(procedure.step.moves, now)
        self._person.instruct(procedure.instruction(), now)

    def close(self) -> None:
        super().close()
        if self._file is not None:
            self._file.close()

    def _move(self, now: float) -> None:
        """The person looks, presses a key or not, and says when the joint is where it should be."""
        if self._person.done or self._procedure is None:
            return
        self._person.look(self._looks(), self._applied.ravel(), now)
        if self._person.lost:
            problem = "the simulated person can't bring a joint to where it should be"
            raise ProfileError(self._place, problem, "Check the guard's bounds and the servo's reach, or the angles")
        if self._person.done and self._procedure.aim is None:
            self._person.done = not self._procedure.go_on()

    def _looks(self) -> Array:
        try:
            assert isinstance(self._fake, Fake)
            return self._fake.looks()
        except NotImplementedError:
            problem = f"the joints of the simulated '{self._fake.name}' can't be seen"
            raise ProfileError(self._place, problem, "Use srl's own driver, or calibrate the real one") from None


class _Person:
    """Who holds the keys.

    Attributes:
        done: whether the joint is where it should be, and the keys are free.
        lost: whether it can't be brought there.
    """

    def __init__(self, hold: Hold, there: float) -> None:
        """`there`: rad, how near an angle the hand lets go."""
        self._hold, self._there = hold, there
        self.done, self.lost = True, False
        self._drive = Drive(0, 0.0)
        self._way, self._best = 1.0, np.inf
        self._next = self._since = self._started = 0.0

    def instruct(self, instruction: object, now: float) -> None:
        """Begins another thing."""
        self.done = not isinstance(instruction, Drive)
        if isinstance(instruction, Drive):
            self._drive, self._way, self._best = instruction, 1.0, np.inf
            self._started = self._since = now
            self._next = now + REST + PAUSE  # the keys are free for a while, or they'd move nothing

    def look(self, seen: Array, commanded: Array, now: float) -> None:
        """What is seen now, (n,) rad."""
        drive = self._drive
        off = float(drive.angle - seen[drive.joint]) if drive.angle is not None else 0.0
        if drive.angle is None and drive.commanded is not None:
            off, self._way = float(drive.commanded - commanded[drive.joint]), 1.0  # the screen says which key
        self.lost = now > self._started + _TIMEOUT
        if abs(off) > self._there:
            self._since = now
            if now >= self._next:
                self._press(off, now)
        self.done = now - max(self._since, self._started + REST) >= _LOOKS

    def _press(self, off: float, now: float) -> None:
        self._next = now + _REPEAT
        self._best = min(self._best, abs(off))
        if abs(off) > self._best + _WRONG:
            self._way, self._best = -self._way, abs(off)
        right = off * self._way > 0.0
        near = abs(off) < _NEAR
        if abs(off) < _TAPS:
            self._next = now + _AFTER
        self._hold.key(("." if right else ",") if near else ("right" if right else "left"), now)
