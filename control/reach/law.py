"""The law `reach`: goes to goals that a client sets, round the body."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.control.reach.connect import Connect, along
from srl.control.reach.goal_search import GoalSearch, search_of_point
from srl.control.reach.mode import Mode
from srl.control.reach.options import ReachConfig
from srl.control.reach.rest_margin import RestMargin
from srl.control.reach.waypoints import AHEAD, NEAR, Waypoints
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

_KEPT: Final = 0.03  # m of margin on the way, where the goal has as much: what is lost while the arm moves
_OUT: Final = 0.04  # m of margin up to which a posture is left
_PACE: Final = 0.5  # of the greatest speed, on the way out
_GIVES: Final = 6.0  # s for which the arm goes back and stays there
_SAME: Final = 0.002  # m, within which a place is still the same
_SLOW: Final = 0.1  # of its greatest speed: slower than that, the arm doesn't come nearer


class Reach(Controller):
    """Straight to the goal where that is free, else round by a way that is planned cycle by cycle, else it waits.

    - DIRECT: the goal itself is commanded, each joint by itself. The guard slows the arm where the body is near.
    - AROUND: the arm hasn't come nearer for `progress_timeout`. All joints go together, straight to the goal where that
      is free, else along a way that RRT-Connect (`srl.control.reach.connect`) finds among postures in which the arm may
      rest (`srl.control.reach.rest_margin`). It is cut short where the arm sees a later point, and looked for anew
      where the body has moved into it.
    - LEAVING: the arm is too near to the body to rest where it is, and for `leave_timeout` it hasn't come nearer to its
      goal: it goes out.
    - WAITING: there is no way at present, or the arm couldn't rest at its goal. It stays as near as the guard lets it.
    - SEARCHING, UNREACHABLE: with `target: point` it stands and looks for a posture in which its end is there and it
      could rest; no posture within the joints' limits puts it there.
    - GIVING_WAY: it hasn't come nearer for `give_way`, and goes back to where it was at the reset, so that the other
      arm can pass. Then it tries again.

    Inputs: `target` (n,) rad (m where a joint slides), or (3,) m in the frame of the node that carries the arms, NaN:
    none; `rotation` (59, 4), `translation` (59, 3) m of the suit; with `other` the joints of the other arm (n,).
    Outputs: `q` (n,), `q_velocity` (n,), wired to the arm's position command; `state` (1,), a `Mode`; `margin`
    (2,) m, of the arm's posture and of its goal's, 0 where it isn't on its way. The guard checks the motion as that of
    any law.

    After a reset the arm stays until a target comes that differs from the one then.
    """

    Config = ReachConfig
    summary = "a worn arm reaches goals, round the body that wears it"

    def __init__(self, name: str, config: ReachConfig) -> None:
        super().__init__(name, config)
        self.options = o = config
        arms, joints = o.arms.arms, o.figure.labels
        n, labels = arms.n, arms.labels
        self._point = o.target == "point"
        self.inputs = (
            Signal(name="target", shape=(3,), unit="m", labels=POINT)
            if self._point
            else Signal(name="target", shape=(n,), unit="rad", labels=labels, slides=arms.slides),
            Signal(name="rotation", shape=(len(joints), 4), unit="1", labels=joints, components=(QUATERNION,)),
            Signal(name="translation", shape=(len(joints), 3), unit="m", labels=joints, components=(POINT,)),
        )
        if o.other:
            self.inputs += (Signal(name="other", shape=(n,), unit="rad", labels=labels, slides=arms.slides),)
        self.outputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=labels, slides=arms.slides),
            Signal(name="q_velocity", shape=(n,), unit="rad/s", labels=labels),
            Signal(name="state", shape=(1,), unit="1"),
            Signal(name="margin", shape=(2,), unit="m", labels=("here", "goal")),
        )
        self._rest, self._scale = RestMargin(o), o.ranges.dq_max
        self._goal: Array | None = None
        self._old = np.full(3 if self._point else n, np.nan)
        self._place: GoalSearch | None = None  # what is looked for, where a goal is a place
        self._wanted: Array | None = None  # the goal that it comes back to
        self._home: Array = np.zeros(n)
        self._back = 0.0  # s for which it still gives way
        self._way: Waypoints | None = None
        self._search: Connect | None = None
        self._kept = 0.0  # m of margin on the way
        # s of the way left where a span began, how long that is, and for how long the arm hasn't come nearer
        self._left, self._span, self._stuck = np.inf, 0.0, 0.0
        self._seed = 0

    def reset(self) -> None:
        self._old[:] = self.input["target"]
        self.output["q"][:] = self.applied.get("q", self.output["q"])
        self.output["q_velocity"][:] = 0.0
        self._rest.forget()
        self._begin(None)
        self._place, self._wanted, self._back = None, None, 0.0
        self._home = self.output["q"] / self._scale
        self._seed = 0
        self._tell(Mode.NO_GOAL)

    def update(self, dt: float) -> None:
        q = np.array(self.applied.get("q", self.output["q"]))
        self._rest.see(self.input["rotation"], self.input["translation"], dt)
        target = self.input["target"]
        if np.isfinite(target).all() and self._differs(target):
            self._old[:] = target
            self._back, self._place = 0.0, None
            if self._point:
                self._begin(None)
                self._place = self._search_of(target.copy())
            else:
                self._begin(np.clip(target, self.options.ranges.q_lower, self.options.ranges.q_upper) / self._scale)
        seen = self._rest.known and self._sees_other()
        if seen and self._place is not None and self._goal is None:
            ranges = self.options.ranges
            if found := self._place.step(q, ranges.q_lower, ranges.q_upper):
                self._begin(found[0] / self._scale)
        if self._goal is None or not seen:
            self._command(q, np.zeros_like(q), dt)
            nothing = Mode.NO_GOAL if self._place is None else self._place.mode
            self._tell(nothing if self._goal is None else Mode.WAITING)
            return
        self._give_way(dt)
        self._towards(q, self._goal, dt)

    def _search_of(self, place: Array) -> GoalSearch:
        """For postures that put the arm's end at `place`, (3,) m, and in which it could rest."""
        arms, side = self.options.arms.arms, self.options.arm
        return search_of_point(arms, side, place, lambda path: self._rest.margins(path) >= 0.0, self._scale)

    def _differs(self, target: Array) -> bool:
        """Whether it is another goal. A place that is measured is never the same twice."""
        if self._point:
            return not bool((np.abs(target - self._old) <= _SAME).all())
        return not np.array_equal(target, self._old)

    def _sees_other(self) -> bool:
        if not self.options.other or (self._goal is None and self._place is None):
            return True
        other = self.input["other"]
        good = bool(np.isfinite(other).all())
        if good:
            self._rest.see_other(other)
        return good

    def _give_way(self, dt: float) -> None:
        """Goes back for a while where nothing else helps; then the goal is tried again."""
        after = self.options.give_way
        if after is None:
            return
        if self._back > 0.0:
            self._back -= dt
            if self._back <= 0.0:
                self._begin(self._wanted)
        elif self._stuck > after:
            self._wanted = self._goal
            self._begin(self._home)
            self._back = _GIVES

    def _begin(self, goal: Array | None) -> None:
        self._goal, self._way, self._search = goal, None, None
        self._left, self._span, self._stuck = np.inf, 0.0, 0.0

    # -- all below in seconds of the way: positions over the joints' greatest speeds

    def _towards(self, q: Array, goal: Array, dt: float) -> None:
        here = q / self._scale
        left = float(np.abs(goal - here).max())
        if left < NEAR:
            self._begin(goal)
            self.output["q"][:], self.output["q_velocity"][:] = goal * self._scale, 0.0
            self._tell(Mode.ARRIVED)
            return
        straight = along(here, goal)
        some = straight[np.unique(np.linspace(0, len(straight) - 1, AHEAD).round().astype(int))]
        margin = self._rest.margins(np.vstack([here, goal, some]) * self._scale)
        rests, self._kept = bool(margin[1] >= 0.0), min(_KEPT, float(margin[1]))
        open_ = rests and bool((margin[2:] >= self._kept).all())
        self._comes(left, dt)
        mode = Mode.DIRECT
        if self._way is not None and not self._way.free(here):
            self._way = None
        if self._way is None and self._stuck > 0.0:
            if open_:
                # All joints together: each by itself they go another way than the straight one.
                self._way = self._along([goal])
            elif margin[0] < max(self._kept, 0.0):
                self._search = None
                mode = Mode.LEAVING if self._stuck > self.options.leave_timeout else mode
            else:
                mode = self._around(here, goal) if rests else Mode.WAITING
        if mode is Mode.LEAVING:
            self._command(q, self._out(q) * self._scale, dt)
        elif self._way is not None:
            mode = Mode.AROUND
            self._command(q, self._way.speed(here) * self._scale, dt)
        elif self.options.other and self._search is not None:
            self._command(q, np.zeros_like(q), dt)  # beside the other arm it goes no nearer while it looks for a way
        else:  # each joint as fast as the guard lets it
            self.output["q"][:], self.output["q_velocity"][:] = goal * self._scale, 0.0
        self._try_another(mode)
        self._tell(Mode.GIVING_WAY if self._back > 0.0 else mode, float(margin[0]), float(margin[1]))

    def _try_another(self, mode: Mode) -> None:
        """A place may be reached by another posture, where the arm can't rest in this one."""
        if self._place is not None and mode is Mode.WAITING and self._stuck > self.options.leave_timeout:
            self._begin(None)

    def _comes(self, left: float, dt: float) -> None:
        """Whether the arm comes nearer: in each span of `progress_timeout` by `_SLOW` of its full speed."""
        self._span += dt
        if self._span >= self.options.progress_timeout:
            self._stuck = 0.0 if left < self._left - _SLOW * self._span else self._stuck + self._span
            self._left, self._span = left, 0.0

    def _around(self, here: Array, goal: Array) -> Mode:
        """Looks for a way, some turns in each cycle."""
        o, ranges = self.options, self.options.ranges
        if self._search is None or self._search.iterations >= o.max_iterations:
            self._seed += 1
            low, high = ranges.q_lower / self._scale, ranges.q_upper / self._scale
            self._search = Connect(here, goal, low, high, self._free, self._seed)
        for _ in range(o.iterations):
            path = self._search.grow()
            if path is not None:
                self._way, self._search = self._along(list(path[1:])), None
                return Mode.AROUND
        return Mode.WAITING

    def _free(self, points: Array) -> NDArray[np.bool_]:
        found: NDArray[np.bool_] = self._rest.margins(points * self._scale) >= self._kept
        return found

    def _along(self, points: list[Array]) -> Waypoints:
        return Waypoints(points, self._free, self.options.ranges.ddq_max / self._scale)

    def _out(self, q: Array) -> Array:
        way = self._rest.outward(q, _OUT) * self._scale
        size = float(np.abs(way).max())
        return way * (_PACE / size) if size > 1e-9 else np.zeros_like(way)

    def _command(self, q: Array, v: Array, dt: float) -> None:
        self.output["q_velocity"][:] = v
        self.output["q"][:] = q + v * dt

    def _tell(self, mode: Mode, here: float = 0.0, goal: float = 0.0) -> None:
        self.output["state"][0] = mode
        self.output["margin"][:] = here, goal
