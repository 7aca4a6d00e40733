"""The guided calibration of servos: each joint is moved to one or two known angles, and then home.

Pure: fed with samples. A joint moves only while the person holds a key; this says which joint that may be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import degrees
from typing import Any, Final

import numpy as np

from srl.commissioning.calibration.guided import Bar, StepProcedure, View
from srl.commissioning.calibration.marks import IDLE
from srl.commissioning.calibration.servos import samples as marks
from srl.commissioning.calibration.servos.fit import HornFit, ServoError, horn_fit, refusals
from srl.commissioning.calibration.servos.samples import Samples, ServoMarksConfig, angles
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Drive, Instruction, Rest

_TURNS: Final = 100.0  # rad, beyond which nobody has said how far the servo goes
_POSITIVE: Final = 0.5  # rad, by which a simulated person moves a joint whose second angle isn't known


class Kind(Enum):
    """Kind of a step."""

    MOVE = "move"
    SETTLE = "settle"
    HOLD = "hold"
    LEAVE = "leave out"
    HOME = "home"
    DONE = "done"


@dataclass(frozen=True)
class Step:
    """One step; `joint` counts from 1, `second`: it is about the joint's second angle."""

    kind: Kind
    joint: int = 0
    second: bool = False

    @property
    def mark(self) -> int:
        """The mark of its samples."""
        if self.kind is Kind.HOLD:
            return (marks.SECOND if self.second else marks.FIRST) + self.joint
        return marks.LEFT_OUT + self.joint if self.kind is Kind.LEAVE else IDLE

    @property
    def moves(self) -> int | None:
        """The joint, from 0 on, that the person's keys may move; None: none."""
        return self.joint - 1 if self.kind in (Kind.MOVE, Kind.HOME) else None


class Procedure(StepProcedure):
    """Goes from step to step as samples come, and as the person says that a joint is where it should be."""

    def __init__(self, options: ServoMarksConfig, before: Mapping[int, tuple[float, float] | None] | None) -> None:
        """
        Args:
            options: of the marks' law.
            before: of an earlier session, by joint from 1 on, the entry's angles at both places (None: left out);
                nothing is left to do until `redo` says so.
        Raises:
            ServoError: the known angles of the plan can't be read.
        """
        self.options, self.plan, self._thresholds = options, options.plan, options.thresholds
        self._names = tuple(options.joints)
        self._first = dict.fromkeys(self._names, 0.0) | angles(self.plan.first, self._names, "first")
        self._second = angles(self.plan.second, self._names, "second")
        self._found: dict[int, tuple[float, float]] = {}
        self._out: set[int] = set()
        self._weak: dict[int, str] = {}
        self._at = np.full(len(self._names), np.nan)
        self._started = 0.0  # rad, the present joint's first place
        self._open = [] if before is not None else list(range(1, len(self._names) + 1))
        self._away = set[int]()  # joints that still have to go home, so that the next run begins where they stand
        if options.home is not None:
            self._away = set(range(1, len(self._names) + 1))
        for joint, found in (before or {}).items():
            if found is None:
                self._out.add(joint)
            else:
                self._found[joint] = found
        self._next()

    def _next(self) -> None:
        # Each goes home as soon as it can; where the home of a weak one is isn't known.
        able = [joint for joint in sorted(self._away) if joint not in self._weak and joint not in self._open]
        if able:
            self._begin(Step(Kind.HOME, able[0]))
        else:
            self._begin(Step(Kind.MOVE, self._open[0]) if self._open else Step(Kind.DONE))

    @property
    def aim(self) -> float | None:
        """rad, the entry's angle of the joint's home; None: the present step isn't about it."""
        if self.step.kind is not Kind.HOME or self.options.home is None:
            return None
        i = self.step.joint - 1
        return self._horn_fit(self.step.joint).entry(self.options.home[i])

    def _horn_fit(self, joint: int) -> HornFit:
        """What was found of a joint; as the profile says, where it was left out. Raises ServoError."""
        if joint not in self._found:
            return HornFit(mirror=self.options.mirror[joint - 1])
        name = self._names[joint - 1]
        return horn_fit(
            self._found[joint], self._first[name], self._second.get(name), self.options.mirror[joint - 1],
            self.options.measures, self._thresholds.apart,
        )  # fmt: skip

    def _columns_of(self, samples: Samples, own: Any) -> tuple[Array, ...]:
        return samples.times[own], samples.angles[own]

    @property
    def _angles(self) -> Array:
        """(T,) rad, of the present joint."""
        return self._columns[1][:, self.step.joint - 1]

    def _fed(self) -> None:
        self._at = self._columns[1][-1]
        step, elapsed = self.step, self._elapsed()
        if step.kind is Kind.LEAVE:
            self._next()
        elif step.kind is Kind.SETTLE and elapsed >= self.plan.settle:
            self._begin(Step(Kind.HOLD, step.joint, step.second))
        elif step.kind is Kind.HOLD and not np.ptp(self._angles) <= self._thresholds.steady:
            self._begin(Step(Kind.SETTLE, step.joint, step.second))  # its samples are too few, so they don't count
        elif step.kind is Kind.HOLD and elapsed >= self.plan.hold:
            self._take()
        elif step.kind is Kind.HOME and self._is_home():
            self._away.discard(step.joint)
            self._next()

    def _take(self) -> None:
        mean, joint = float(self._angles.mean()), self.step.joint
        if not self.step.second:
            self._started = mean
            self._begin(Step(Kind.MOVE, joint, True))
            return
        self._found[joint] = self._started, mean
        self._out.discard(joint)
        self._weak.pop(joint, None)
        options, i, name = self.options, joint - 1, self._names[joint - 1]
        try:
            found = self._horn_fit(joint)
        except ServoError as error:
            refused = [error]
        else:
            home = None if options.home is None else options.home[i]
            refused = refusals(
                name, found, self._found[joint], self._second.get(name), home, (options.lower[i], options.upper[i]),
                self._thresholds,
            )  # fmt: skip
        if refused:
            self._weak[joint] = f"{refused[0].problem}. {refused[0].remedy}"
        self._open.remove(joint)
        self._next()

    def _is_home(self) -> bool:
        """Whether it has stood at its home for a while."""
        aim, now = self.aim, self._times[-1]
        recent = self._angles[self._times >= now - self.plan.settle]
        return (
            aim is not None and bool(now - self._times[0] >= self.plan.settle)
            and bool(np.ptp(recent) <= 1e-6) and abs(recent[-1] - aim) <= self._thresholds.home
        )  # fmt: skip

    def instruction(self) -> Instruction:
        step = self.step
        if step.kind is Kind.HOME:
            return Drive(step.joint - 1, None, self.aim)
        if step.kind is not Kind.MOVE:
            return Rest()
        name = self._names[step.joint - 1]
        first = self._first[name]
        return Drive(step.joint - 1, self._second.get(name, first + _POSITIVE) if step.second else first)

    def go_on(self) -> str:
        """The joint is where it should be. Returns why that can't be; "" if it could."""
        step = self.step
        if step.kind is Kind.HOME:
            return f"hold a key until it is home, within {self._thresholds.home:g} rad"
        if step.kind in (Kind.SETTLE, Kind.HOLD):
            return f"it is being taken: {self.plan.hold:g} s"
        if step.kind is Kind.MOVE:
            if step.second and not abs(self._at[step.joint - 1] - self._started) >= self._thresholds.apart:
                return f"move it further: by {self._thresholds.apart:g} rad at least"
            self._begin(Step(Kind.SETTLE, step.joint, step.second))
        return ""

    def skip(self) -> str:
        step = self.step
        if step.kind is Kind.HOME:
            return "bring it home first: the next run begins there"
        if step.kind in (Kind.LEAVE, Kind.DONE):
            return ""
        if len(self._out | {step.joint}) == len(self._names):
            return "one joint must remain"
        self._out.add(step.joint)
        self._found.pop(step.joint, None)
        self._weak.pop(step.joint, None)
        self._open.remove(step.joint)
        self._begin(Step(Kind.LEAVE, step.joint))
        return ""

    def redo(self, number: int) -> str:
        if not 1 <= number <= len(self._names):
            return f"the joints are 1 to {len(self._names)}"
        if number in self._open:
            self._open.remove(number)
        self._open.insert(0, number)
        if self.options.home is not None:
            self._away.add(number)
        self._found.pop(number, None)
        self._weak.pop(number, None)
        self._out.discard(number)
        self._begin(Step(Kind.MOVE, number))
        return ""

    def view(self) -> View:
        step, lack = self.step, ""
        lost = not self.done and not bool(np.isfinite(self._at[step.joint - 1]))
        missing = "where the joint is isn't known" if lost and len(self._times) else ""
        return View(step, self._task(), lack, missing, self._states(), self._bars(), "joints")

    def _task(self) -> str:
        step = self.step
        if step.kind is Kind.DONE:
            return "All joints are done"
        name = self._names[step.joint - 1]
        if step.kind is Kind.LEAVE:
            return f"'{name}' is left out"
        if step.kind in (Kind.SETTLE, Kind.HOLD):
            return f"Leave '{name}' as it is"
        if step.kind is Kind.HOME:
            return (
                f"Bring '{name}' home: hold {'right' if self._to_go() > 0 else 'left'}, by {abs(self._to_go()):.3f} rad"
            )
        if step.second and name not in self._second:
            return f"Move '{name}' to its POSITIVE side, by {self._thresholds.apart:g} rad or more, then go on"
        angle = self._second[name] if step.second else self._first[name]
        where = "at 0 (straight)" if angle == 0.0 else f"at {angle:g} rad ({degrees(angle):.1f} degrees)"
        return f"Move '{name}' until it stands {where}, then go on"

    def _to_go(self) -> float:
        aim = self.aim
        return 0.0 if aim is None else float(aim - self._at[self.step.joint - 1])

    def _bars(self) -> tuple[Bar, ...]:
        step, i = self.step, self.step.joint - 1
        if self.done or not np.isfinite(self._at[i]):
            return ()
        low, high = self.options.lower[i], self.options.upper[i]
        share = min(max((self._at[i] - low) / (high - low), 0.0), 1.0) if high - low < _TURNS else None
        bars = [Bar(self._names[i], share, f"{self._at[i]:.3f} rad in the profile's own angle")]
        if step.kind is Kind.HOLD:
            bars.append(Bar("held", min(self._elapsed() / self.plan.hold, 1.0), ""))
        if step.kind is Kind.HOME:
            near = abs(self._to_go()) <= self._thresholds.home
            bars.append(Bar("to go", None, f"{self._to_go():+.3f} rad", near))
        return tuple(bars)

    def _states(self) -> tuple[str, ...]:
        def state(number: int) -> str:
            if number == self.step.joint and not self.done:
                return "now"
            if number in self._open:
                return "waiting"
            if number in self._weak:
                return f"weak: {self._weak[number]}"
            return "left out" if number in self._out else "done"

        return tuple(state(number) for number in range(1, len(self._names) + 1))
