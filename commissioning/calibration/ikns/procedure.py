"""The guided procedure that collects a calibration: what to do now, what counts so far, when a step is over.

Pure: it is fed with samples and asked for its view. Lisini Baldi et al. 2023, section III: static, exploration, ten
points near the corners and the middle of the explored workspace, at each the motion that leaves the hand still.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Final, cast

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.guided import StepProcedure, View
from srl.commissioning.calibration.ikns import marks
from srl.commissioning.calibration.ikns.samples import LEAST_POINTS, Samples
from srl.commissioning.calibration.ikns.steps import Kind, Progress, Step
from srl.control.ikns.calibration import CalibrationError
from srl.control.ikns.clusters import box_points, hand_speed
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Dof, Explore, Hold, Instruction, Rest

_TAIL: Final = 0.5  # s, over which the live speed and the share of lost samples are taken
_SEEN: Final = 0.8  # share of samples that must have angles and hand
_EDGE: Final = 2.0  # %, of the explored positions on each side that the box leaves out: single strays
_MOTIONS: Final = {
    "swivel": "Swing the elbow out and in, as far as it goes, slowly. The hand stays and doesn't turn",
    "shrug": "Lift the shoulder and let it sink, as far as it goes, slowly. The hand stays and doesn't turn",
    "protraction": "Push the shoulder forward and draw it back, as far as it goes, slowly. The hand stays",
}


class Plan(Options):
    """How long the steps take, and when they are over."""

    static: float = Field(5.0, gt=0.0, description="s of sitting still")
    exploration: float = Field(60.0, gt=0.0, description="s of moving the hand through its workspace")
    trial: float = Field(5.0, gt=0.0, description="s of motion at a point and DoF")
    near: float = Field(0.03, gt=0.0, description="m, the hand's distance from a point at which it is there")
    settle: float = Field(1.0, gt=0.0, description="s for which the hand is still before a trial begins")
    patience: float = Field(20.0, gt=0.0, description="s beyond its time after which a step ends as it is")
    depth: float = Field(0.12, gt=0.0, description="m, least size of the explored box in each direction")
    inset: float = Field(0.8, gt=0.0, le=1.0, description="size of the points' box, in that of the explored box")


class Procedure(StepProcedure):
    """Goes from step to step as samples come; see the module's docstring.

    Attributes:
        step: the present step.
        points: (N, 3) m, once the workspace is explored.
    """

    def __init__(
        self,
        dofs: tuple[str, ...],
        thresholds: Thresholds | None = None,
        plan: Plan | None = None,
        explored: Array | None = None,
    ) -> None:
        """
        Args:
            dofs: names of the degrees of freedom.
            thresholds, plan: the defaults if left out.
            explored: (T, 3) m, finite: positions explored in an earlier run, of which points are to be done again with
                `redo`. Its points are done, and nothing else is left to do.
        Raises:
            CalibrationError: they aren't a workspace.
        """
        self.dofs, self.thresholds, self.plan = dofs, thresholds or Thresholds(), plan or Plan()
        self.points: Array | None = None
        self._lacks: list[list[str | None]] = []  # of each point and DoF; None: not done. "": nothing
        self._out: set[int] = set()
        self._box: Array | None = None
        self._queue: deque[tuple[int, int]] = deque()
        self._begin(Step(Kind.STATIC))
        if explored is not None:
            self._box = None if not len(explored) else _box(explored)
            if lack := self._shallow():
                raise CalibrationError("the earlier exploration", lack, "Calibrate anew")
            self.points = self._choose(explored)
            self._lacks = [[""] * len(dofs) for _ in self.points]
            self._begin(Step(Kind.DONE))

    def _columns_of(self, samples: Samples, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.hand[own], samples.angles[own]

    @property
    def _hand(self) -> Array:
        """(T, 3) m."""
        return self._columns[1] if self._columns else np.empty((0, 3))

    def _fed(self) -> None:
        """Raises CalibrationError: static or exploration can't be finished."""
        times, hand, angles = self._columns
        self._seen = np.isfinite(times) & np.isfinite(hand).all(axis=1) & np.isfinite(angles).all(axis=1)
        self._speed = hand_speed(self._times, self._hand)
        {
            Kind.STATIC: self._static, Kind.EXPLORATION: self._explore, Kind.GO: self._go, Kind.TRIAL: self._try,
        }[self.step.kind]()  # fmt: skip

    def go_on(self) -> str:
        if self.step.kind is Kind.EXPLORATION and (lack := self._shallow()):
            return lack
        if self.step.kind is not Kind.DONE:
            self._next()
        return ""

    def redo(self, number: int) -> str:
        if self.points is None:
            return "the points aren't chosen yet"
        if not 1 <= number <= len(self.points):
            return f"the points are 1 to {len(self.points)}"
        at = number - 1
        undone = marks.VOID if self.step.kind is Kind.TRIAL else marks.IDLE
        if self.step.kind in (Kind.GO, Kind.TRIAL) and self.step.point != at:
            left = [(self.step.point, j) for j in range(self.step.dof, len(self.dofs))]
            self._queue.extendleft(reversed([e for e in left if e not in self._queue]))
        self._queue = deque(entry for entry in self._queue if entry[0] != at)
        self._queue.extendleft(reversed([(at, j) for j in range(len(self.dofs))]))
        self._lacks[at] = [None] * len(self.dofs)
        self._out.discard(at)
        self._advance(undone)
        return ""

    def skip(self) -> str:
        """Leaves the present point out, with all of its trials so far. Returns why that can't be; "" if it could."""
        if self.step.kind not in (Kind.GO, Kind.TRIAL):
            return "only a point can be left out"
        at = self.step.point
        if len(self._lacks) - len(self._out | {at}) < LEAST_POINTS:
            return f"{LEAST_POINTS} points are needed"
        self._queue = deque(entry for entry in self._queue if entry[0] != at)
        self._out.add(at)
        self._advance(marks.left_out(at))
        return ""

    @property
    def target(self) -> Array | None:
        """(3,) m: the present step's point; None where it has none."""
        return None if self.points is None or self.step.point < 0 else self.points[self.step.point]

    def instruction(self) -> Instruction:
        if self.step.kind is Kind.EXPLORATION:
            return Explore(self.plan.exploration)
        if self.target is None:
            return Rest()
        x, y, z = self.target.tolist()
        return Hold((x, y, z), cast(Dof, self.dofs[self.step.dof]) if self.step.kind is Kind.TRIAL else None)

    def view(self) -> View:
        # What a trial lacks, it may still get in its time.
        early = self.step.kind is Kind.TRIAL and self._elapsed() < self._span()
        states = tuple(self._state(at) for at in range(len(self._lacks)))
        return self.progress().view(self._task(self._gap()), self._unseen() if early else self._lack, states)

    def progress(self) -> Progress:
        """How far the present step is."""
        tail = self._times >= (self._times[-1] if len(self._times) else 0.0) - _TAIL
        moving = self._speed[tail & np.isfinite(self._speed)]
        trial = self.step.kind is Kind.TRIAL
        return Progress(
            self.step, min(self._elapsed() / self._span(), 1.0), float(moving[-1]) if len(moving) else np.nan,
            float(np.linalg.norm(self._gap())), 1.0 - float(self._seen[tail].mean()) if tail.any() else 0.0,
            self._kept if trial else 0, self.thresholds.samples, self._range if trial else 0.0, self.thresholds.range,
            self._box,
        )  # fmt: skip

    def _gap(self) -> Array:
        """(3,) m, from the hand as it was seen last to the target; NaN where one of them isn't known."""
        seen = np.flatnonzero(self._seen)
        return np.full(3, np.nan) if self.target is None or not len(seen) else self.target - self._hand[seen[-1]]

    # Steps

    def _begin(self, step: Any) -> None:
        super()._begin(step)
        self._seen, self._speed = np.empty(0, bool), np.empty(0)
        # A trial that is ended before a sample has come isn't done.
        self._kept, self._range, self._lack = 0, 0.0, "nothing was seen" if step.kind is Kind.TRIAL else ""

    def _next(self) -> None:
        step = self.step
        if step.kind is Kind.STATIC:
            self._begin(Step(Kind.EXPLORATION))
        elif step.kind is Kind.EXPLORATION:
            self.points = self._choose(self._hand[self._seen])
            self._lacks = [[None] * len(self.dofs) for _ in self.points]
            self._queue.extend((i, j) for i in range(len(self.points)) for j in range(len(self.dofs)))
            self._advance()
        elif step.kind is Kind.GO:
            self._begin(Step(Kind.TRIAL, step.point, step.dof))
        else:
            self._lacks[step.point][step.dof] = self._lack
            self._advance()

    def _advance(self, undone: int = marks.IDLE) -> None:
        if not self._queue:
            self._begin(Step(Kind.DONE, undone=undone))
            return
        self._begin(Step(Kind.GO, *self._queue.popleft(), undone))

    def _state(self, at: int) -> str:
        """As in `View.states`."""
        if at == self.step.point:
            return "now"
        if at in self._out:
            return "left out"
        lacks = self._lacks[at]
        if None in lacks:
            return "waiting"
        named = len(lacks) > 1
        weak = [f"{dof}: {lack}" if named else lack for dof, lack in zip(self.dofs, lacks, strict=True) if lack]
        return f"weak: {'; '.join(weak)}" if weak else "done"

    def _span(self) -> float:
        """s that the step takes at best."""
        plan = self.plan
        return {Kind.STATIC: plan.static, Kind.EXPLORATION: plan.exploration, Kind.TRIAL: plan.trial}.get(
            self.step.kind, plan.settle
        )

    def _late(self) -> bool:
        return self._elapsed() >= self._span() + self.plan.patience

    def _quiet(self, seconds: float) -> bool:
        """Whether the hand was seen and still for the last seconds."""
        if self._elapsed() < seconds:
            return False
        tail = self._times >= self._times[-1] - seconds
        tail &= self._times <= self._times[-1] - 0.05  # a speed at the very end is of too few samples
        good = self._seen & (np.nan_to_num(self._speed, nan=np.inf) < self.thresholds.speed)
        return bool(tail.any()) and float(good[tail].mean()) >= _SEEN

    def _unseen(self) -> str:
        share = 1.0 - float(self._seen.mean()) if len(self._seen) else 0.0
        return f"{share:.0%} of the samples lack angles or hand: markers are missing" if share > 1.0 - _SEEN else ""

    def _static(self) -> None:
        if self._quiet(self.plan.static):
            self._next()
            return
        self._lack = self._unseen() or ("" if self._elapsed() < self._span() else "the hand isn't still")
        if self._late():
            raise CalibrationError("static", self._lack, "Sit still with all markers in view, and begin again")

    def _explore(self) -> None:
        hand = self._hand[self._seen]
        if len(hand):
            self._box = _box(hand)
        self._lack = self._unseen() or self._shallow()
        if self._elapsed() >= self._span() and not self._lack:
            self._next()
        elif self._late():
            raise CalibrationError("exploration", self._lack, "Begin again, and move the hand through all of its space")

    def _shallow(self) -> str:
        if self._box is None:
            return "the hand wasn't seen yet"
        size = self._box[1] - self._box[0]
        if (size >= self.plan.depth).all():
            return ""
        words = ("forward and back", "to the left and right", "up and down")
        axis = int(size.argmin())
        return f"only {1e3 * size[axis]:.0f} mm {words[axis]} explored, {1e3 * self.plan.depth:.0f} are needed"

    def _choose(self, hand: Array) -> Array:
        """The points: those of a smaller box, each moved to the nearest place where the hand (T, 3) has been."""
        assert self._box is not None
        middle = self._box.mean(axis=0)
        wanted = box_points(middle + self.plan.inset * (self._box - middle), self.thresholds.points, self.thresholds.up)
        nearest = np.linalg.norm(hand[:, None] - wanted, axis=2).argmin(axis=0)
        found: Array = hand[nearest]
        return found

    def _go(self) -> None:
        there = self._quiet(self.plan.settle)
        seen = self._hand[self._seen]
        assert self.target is not None
        gap = float(np.linalg.norm(seen[-1] - self.target)) if len(seen) else np.inf
        late = self._late()
        if there and (gap <= self.plan.near or late):
            self._next()  # late: as near as it gets, for the points needn't be exact
            return
        self._lack = self._unseen() or ("" if self._elapsed() < self._span() else "the hand isn't still at the point")
        if self._elapsed() >= self._span() + 2.0 * self.plan.patience:
            self._next()

    def _try(self) -> None:
        th, seen = self.thresholds, self._seen
        slow = seen & (np.nan_to_num(self._speed, nan=np.inf) < th.speed)
        if slow.any():
            middle = self._hand[slow].mean(axis=0)
            slow[slow] = np.linalg.norm(self._hand[slow] - middle, axis=1) <= th.radius
        self._kept = int(slow.sum())
        self._range = _extent(self._columns[2][slow])
        self._lack = self._unseen()
        if not self._lack and self._kept < th.samples:
            self._lack = f"{self._kept} of {th.samples} samples kept: hold the hand stiller"
        elif not self._lack and self._range < th.range:
            self._lack = f"range {self._range:.2f} of {th.range} rad: move farther"
        if (self._elapsed() >= self._span() and not self._lack) or self._late():
            self._next()

    def _task(self, gap: Array) -> str:
        step = self.step
        if step.kind is Kind.STATIC:
            return "Sit still, the forearm in front of you"
        if step.kind is Kind.EXPLORATION:
            return "Move the hand slowly through all of its space, also up and down; the torso stays"
        if step.kind is Kind.DONE:
            return "All points are done"
        which = f"point {step.point + 1} of {len(self._lacks)}"
        if step.kind is Kind.TRIAL:
            dof = self.dofs[step.dof]
            return (
                f"{_MOTIONS.get(dof, f'Move {dof} alone, there and back, as far as it goes; the hand stays')} ({which})"
            )
        words = (("forward", "back"), ("left", "right"), ("up", "down"))
        ways = [
            f"{100 * abs(g):.0f} cm {w[0] if g > 0 else w[1]}"
            for g, w in zip(gap, words, strict=True)
            if abs(g) >= 0.01
        ]
        return f"Take the hand to {which} and hold it there" + (f": {', '.join(ways)}" if ways else "")


def _box(hand: Array) -> Array:
    """(2, 3) m: the corners of the box of positions (T, 3), without strays."""
    found: Array = np.percentile(hand, (_EDGE, 100.0 - _EDGE), axis=0)
    return found


def _extent(angles: Array) -> float:
    """rad, the range of angles (T, n) along their first principal component."""
    if len(angles) < 2:
        return 0.0
    away = angles - angles.mean(axis=0)
    along = away @ np.linalg.eigh(away.T @ away)[1][:, -1]
    return float(along.max() - along.min())
