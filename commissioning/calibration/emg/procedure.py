"""The guided calibration of surface EMG: rest, then each muscle's greatest contraction, again and again. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np

from srl.commissioning.calibration.emg.fit import Thresholds
from srl.commissioning.calibration.emg.samples import REST, Plan, Samples, mark
from srl.commissioning.calibration.guided import Bar, View
from srl.commissioning.calibration.guided import Procedure as Guided
from srl.commissioning.calibration.marks import IDLE
from srl.control.emg.blocks import GONE, Stream
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Contract, Instruction, Rest

_NONE: Final = np.empty(0, np.intp)


class Kind(Enum):
    """Kind of a step."""

    READY = "ready"
    REST = "rest"
    PAUSE = "pause"
    CONTRACT = "contract"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; muscle and repeat count from 1, 0: none."""

    kind: Kind
    muscle: int = 0
    repeat: int = 0

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        if self.kind is Kind.CONTRACT:
            return mark(self.muscle, self.repeat)
        return REST if self.kind is Kind.REST else IDLE


class Procedure(Guided):
    """Goes from step to step as samples come. A contraction counts from its onset: `factor` times the rest level."""

    def __init__(
        self, muscles: Sequence[str], plan: Plan, thresholds: Thresholds, rest: Array | None = None
    ) -> None:  # fmt: skip
        """`rest` (n,) V: the level of an earlier time; then nothing is left to do until `redo` says so."""
        self.plan, self._muscles, self._factor = plan, tuple(muscles), thresholds.factor
        n = len(self._muscles)
        self._stream = Stream(n, plan.filters(), stuck=False)
        self._silent = _NONE  # muscles whose sensor gives exact zeros
        self._level, self._best = np.full(n, np.nan), np.zeros(n)
        self._rest = np.full(n, np.nan) if rest is None else rest
        self._open: list[tuple[int, int]] = []
        if rest is None:
            self._open = [(0, 0), *((i, j) for i in range(1, n + 1) for j in range(1, plan.repeats + 1))]
        self._next()

    def _next(self) -> None:
        if not self._open:
            self._begin(Step(Kind.DONE))
            return
        muscle, repeat = self._open[0]
        self._begin(Step(Kind.PAUSE if muscle else Kind.READY, muscle, repeat))

    def _begin(self, step: Step) -> None:
        self.step = step
        self._since = self._onset = self._now = np.nan
        self._levels: list[Array] = []

    def feed(self, samples: Samples) -> None:
        for time, block, count, each in zip(
            samples.times, samples.blocks, samples.counts, samples.marks, strict=True
        ):  # fmt: skip
            found = self._stream.take(block, float(count))
            if found is not None and len(found):
                self._level = found[-1]
            self._silent = np.flatnonzero((block[-GONE:] == 0.0).all(axis=0)) if found is None else _NONE
            if each == self.step.mark and not self.done:
                self._row(float(time), found is None)

    def _row(self, time: float, gap: bool) -> None:
        """One row of the present step."""
        kind, plan = self.step.kind, self.plan
        self._now = time
        if np.isnan(self._since):
            self._since = time
        elif gap and kind in (Kind.REST, Kind.CONTRACT):
            self._next()  # samples are missing: it is done again, from the pause before it on
            return
        if self._stream.settled:
            self._levels.append(self._level)
        elapsed = time - self._since
        if kind is Kind.READY and elapsed >= plan.read and self._stream.settled:
            self._begin(Step(Kind.REST))
        elif kind is Kind.PAUSE and elapsed >= plan.pause and self._stream.settled:
            self._begin(Step(Kind.CONTRACT, self.step.muscle, self.step.repeat))
        elif kind is Kind.REST and elapsed >= plan.rest:
            self._rest = np.mean(self._levels, axis=0)
            self._take()
        elif kind is Kind.CONTRACT:
            own = self.step.muscle - 1
            if np.isnan(self._onset) and self._level[own] > self._factor * self._rest[own]:
                self._onset = time
            if time - self._onset >= plan.hold or (np.isnan(self._onset) and elapsed >= plan.patience):
                self._best = np.maximum(self._best, np.max(self._levels, axis=0))
                self._take()

    def _take(self) -> None:
        self._open.pop(0)
        self._next()

    def instruction(self) -> Instruction:
        return Contract(self._muscles[self.step.muscle - 1]) if self.step.kind is Kind.CONTRACT else Rest()

    def go_on(self) -> str:
        """Ends a pause early. Returns why that can't be; "" if it could."""
        kind = self.step.kind
        if kind in (Kind.REST, Kind.CONTRACT):
            return "it ends by itself"
        if kind is not Kind.DONE and not self._stream.settled:
            return "the muscles aren't measured"
        if kind is Kind.READY:
            self._begin(Step(Kind.REST))
        elif kind is Kind.PAUSE:
            self._begin(Step(Kind.CONTRACT, self.step.muscle, self.step.repeat))
        return ""

    def skip(self) -> str:
        """Leaves nothing out: each muscle is needed."""
        return "" if self.done else "every muscle is needed; take one that can't be had out of the profile's `channels`"

    def redo(self, number: int) -> str:
        """Does a muscle's contractions again, next; 0: the rest. Returns why that can't be; "" if it could."""
        if not 0 <= number <= len(self._muscles):
            return f"the muscles are 1 to {len(self._muscles)}, 0 is the rest"
        repeats = range(1, self.plan.repeats + 1) if number else (0,)
        self._open = [each for each in self._open if each[0] != number]
        at = 1 if number and (0, 0) in self._open else 0  # no onset is known before the rest level is
        self._open[at:at] = [(number, each) for each in repeats]
        self._next()
        return ""

    def view(self) -> View:
        kind = self.step.kind
        name = self._muscles[self.step.muscle - 1] if self.step.muscle else ""
        words = {
            Kind.READY: "Relax every muscle, and go on doing so",
            Kind.REST: "Stay relaxed",
            Kind.PAUSE: f"Rest. Next: {name}, contraction {self.step.repeat} of {self.plan.repeats}",
            Kind.CONTRACT: f"NOW contract {name} as hard as you can, and hold it",
            Kind.DONE: "All muscles are done",
        }
        lack = "no contraction is seen yet" if kind is Kind.CONTRACT and np.isnan(self._onset) else ""
        silent = ", ".join(self._muscles[i] for i in self._silent)
        missing = "" if self._stream.settled or np.isnan(self._now) else f"not measured: {silent or 'the muscles'}"
        return View(self.step, words[kind], lack, missing, self._states(), self._bars(), "muscles")

    def _bars(self) -> tuple[Bar, ...]:
        kind, plan = self.step.kind, self.plan
        whole = {Kind.READY: plan.read, Kind.REST: plan.rest, Kind.PAUSE: plan.pause, Kind.CONTRACT: plan.hold}
        since = self._onset if kind is Kind.CONTRACT else self._since
        gone = 0.0 if np.isnan(self._now - since) else self._now - since
        bars = []
        if kind in whole:
            left = max(whole[kind] - gone, 0.0)
            bars.append(Bar("time", min(gone / whole[kind], 1.0), f"{left:.0f} s left"))
        for name, level, best in zip(self._muscles, self._level, self._best, strict=True):
            share = None if not best or np.isnan(level) else float(min(level / best, 1.0))
            text = "?" if np.isnan(level) else f"{1e6 * level:6.1f} uV"
            bars.append(Bar(name, share, text))
        return tuple(bars)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.muscle:
                return "now"
            return "waiting" if any(each[0] == number for each in self._open) else "done"

        return tuple(state(number) for number in range(1, len(self._muscles) + 1))
