"""Back to a path's place by another way, where bending doesn't lead there.

A posture is looked for that puts the arm's end at the place, in which the arm could rest, and from which it can follow
the path for some seconds; and a way to it among postures in which it could rest: `srl.control.reach`, a bounded part of
it in each cycle.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.control.operation.demonstration import TaskError
from srl.control.operation.reach import Reach
from srl.control.operation.replay import Replay
from srl.control.operation.worn import Worn
from srl.control.reach.connect import Connect
from srl.control.reach.goal_search import GoalSearch, search_of_point
from srl.control.reach.options import MarginOptions
from srl.control.reach.rest_margin import RestMargin
from srl.control.reach.waypoints import NEAR, Waypoints
from srl.runtime.contracts.signals import Array

_NEARER: Final = 0.005  # m in a span: less is no progress
_ADVANCE: Final = 0.05  # of the path's own pace in a span: less is no progress
_KEPT: Final = 0.02  # m of margin on the way, where its end has as much: what is lost while the arm moves
_TURNS: Final = 400  # of a search for a way, after which another posture is looked for
_BODY: Final = 4.0  # times as long is waited where the body is in the way: mostly it goes away by itself
_FOLLOWED: Final = 5.0  # s of the path that a posture must be able to go on
_STEPS: Final = 8  # of that, in a cycle
_OTHER: Final = 0.05  # s of the joints' way: a posture that is nearer isn't another one
_GIVE_UP: Final = 3.0  # s without coming nearer on the way
_PACE: Final = 0.5  # of the joints' greatest speeds, on the way
_LONGEST: Final = 8.0  # times `plan_after` is waited, after ways that have led nowhere


class Detour:
    """Looks for a way where the task has come no nearer for `plan_after`, and follows it.

    Attributes:
        on: it is on its way.
    """

    def __init__(self, options: MarginOptions, arm: Worn, keep: float, plan_after: float) -> None:
        """
        Args:
            options: of the margin, and the joints' limits.
            arm: used while it looks, so its posture changes.
            keep: m, that bending keeps: less would be undone at the end of a way.
            plan_after: s in which a task comes no nearer to its next place before a way is looked for.
        """
        self._options, self._arm, self._after = options, arm, plan_after
        self._least = max(keep - options.least - options.uncertainty, 0.0)  # m of margin
        self._longer, self._from = 1.0, -np.inf  # how much longer is waited, and the phase at the last way
        self._rest, self._scale = RestMargin(options), options.ranges.dq_max
        self._seed = 0
        self.drop()

    @property
    def on(self) -> bool:
        return self._way is not None

    def drop(self) -> None:
        """Gives up what was looked for."""
        self._postures: GoalSearch | None = None
        self._found: list[Array] = []  # postures there, that aren't tried yet
        self._follow: tuple[Array, Reach] | None = None  # the one that is tried, scaled
        self._search: Connect | None = None
        self._way: Waypoints | None = None
        self._kept = 0.0
        self._left, self._stood = np.inf, 0.0  # s of the way, and for how long it hasn't become less
        self._span, self._error, self._phase = 0.0, np.inf, -np.inf

    def see(self, rotation: Array, translation: Array, dt: float) -> None:
        """Takes the suit's sample: (k, 4) unit quaternions and (k, 3) m; dt s since the one before, 0 forgets it."""
        if dt <= 0.0:
            self._rest.forget()
        self._rest.see(rotation, translation, dt)

    def step(self, q: Array, before: Array, task: Replay, dt: float) -> Array | None:
        """The velocity (n,), rad/s or m/s, on the way; None where the task is followed as ever.

        Args:
            q: (n,) rad or m, as commanded.
            before: (n,) rad/s or m/s, of the cycle before.
            task: what is followed; `hold` it where this returns a velocity, else `step` it.
            dt: s.
        """
        if not self._rest.known:
            self.drop()
            return None
        if self._way is None:
            if not self._stands(task, dt):
                return None
            self._look(q / self._scale, task)
            if self._way is None:
                return None
        return self._along(q / self._scale, before / self._scale, self._way, dt)

    def _stands(self, task: Replay, dt: float) -> bool:
        """Whether the task has come no nearer for a span; then until it does, or begins again."""
        advanced = not -1e-9 <= task.s - self._phase <= _ADVANCE * self._after
        if advanced or task.error < self._error - _NEARER:
            if task.s < self._phase - 1e-9:
                self._longer, self._from = 1.0, -np.inf
            self.drop()  # where the task begins again its error isn't of this place yet
            self._error, self._phase = np.inf if advanced else task.error, task.s
        self._span += dt / _BODY if task.blocked else dt
        return self._span > self._after * self._longer

    def _look(self, here: Array, task: Replay) -> None:
        """One step of the search for a posture, or for a way to it."""
        if self._search is None:
            goal = self._posture(here, task)
            if goal is None:
                return
            ends = self._rest.margins(np.vstack([here, goal]) * self._scale)
            self._kept = min(max(_KEPT, self._least), *ends.tolist())
            self._seed += 1
            low, high = self._options.ranges.q_lower / self._scale, self._options.ranges.q_upper / self._scale
            self._search = Connect(here, goal, low, high, self._free, self._seed)
        points = self._search.grow()
        if points is not None:
            self._way = Waypoints(list(points[1:]), self._free, self._options.ranges.ddq_max / self._scale)
            self._search, self._left, self._stood = None, np.inf, 0.0
            again = task.s <= self._from + _ADVANCE * self._after
            self._longer, self._from = min(2.0 * self._longer, _LONGEST) if again else 1.0, task.s
        elif self._search.iterations >= _TURNS:
            self._search = None

    def _posture(self, here: Array, task: Replay) -> Array | None:
        """Another posture (n,), scaled, at the task's place, from which the arm can go on; None: not yet."""
        ranges = self._options.ranges
        if self._follow is not None:
            goal, follow = self._follow
            try:
                if not follow.step(_STEPS):
                    return None
            except TaskError:
                self._follow = None
                return None
            self._follow = None
            return goal
        while self._found:
            goal = self._found.pop(0) / self._scale
            if float(np.abs(goal - here).max()) > _OTHER:
                self._follow = goal, Reach(task.rest(_FOLLOWED), self._arm, ranges, goal * self._scale)
                return None
        if self._postures is None:
            arms, side = self._options.arms.arms, self._options.arm
            self._postures = search_of_point(
                arms, side, task.place, lambda path: self._rest.margins(path) >= self._least, self._scale
            )
        self._found = self._postures.step(here * self._scale, ranges.q_lower, ranges.q_upper)
        return None

    def _along(self, here: Array, before: Array, way: Waypoints, dt: float) -> Array | None:
        left = way.left(here)
        self._stood = 0.0 if left < self._left - NEAR else self._stood + dt
        self._left = min(self._left, left)
        if left < 10 * NEAR or self._stood > _GIVE_UP or not way.free(here):
            self.drop()
            return None
        change = _PACE * way.speed(here) - before
        step = self._options.ranges.ddq_max / self._scale * dt
        most = float((np.abs(change) / step).max())  # all joints together, so that it goes on between the two
        return (before + change / max(most, 1.0)) * self._scale

    def _free(self, points: Array) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = self._rest.margins(points * self._scale) >= self._kept
        return found
