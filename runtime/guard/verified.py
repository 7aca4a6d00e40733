"""The verified stop: a command is accepted only if the limb can brake from it, on its path, and keep clear throughout.

Let x be what is applied, x' what the guard would apply next, and S(x') the stop from x'. Each cycle x' is accepted if
the clearance accepts the motion x -> x' -> S(x'); else the limb goes on with S(x), which was accepted with x. So at
every instant the limb is on a motion to rest that was accepted as a whole: where a clearance is right about the limb
and the other side, the limb is at rest before anything comes nearer than it allows. Three things are needed for this:

- the stop that is carried out is the stop that was checked. S scales all joints together: with T = max |v_i|/A_i each
  brakes by v_i/T, so that all end at once and the limb stays on a straight line in joint space. From any state on the
  way T is what is left of it, so the rest of a stop is the stop of the rest. (With a bounded jerk each joint brakes as
  fast as it can; that stop has the same property, but it isn't straight.)
- the times are those of the limb and not of its command. A servo may be `lag` late, so the limb may be on its way to a
  sample until the sample's time plus `lag` and `timeout`, the longest that a cycle may last; beside that, it may be off
  by `tracking`, or by what is measured where that is more. A limb that is commanded by position waits while a cycle
  lasts longer. So a stop that goes on after such a cycle is a new motion: it is carried out if it is accepted, and else
  the limb rests where it waits;
- a joint may be later than another. With lags between l and L, joint i is where its command was between l and L ago. It
  is beside the place where all commands were (l + L)/2 ago by (L - l)/2 times its largest speed in that time at most,
  which is |v_i| + A_i L. Its velocity is beside the others' by A_i (L - l) at most.

A limb that is commanded by velocity goes on while the loop is late, until its device's own time-out ends that. So its
stop begins `goes_on` later and farther.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import ceil, inf, isinf, nan
from operator import mul
from typing import Final

import numpy as np

from srl.runtime.contracts.clearance import Braking, Clearance
from srl.runtime.contracts.signals import Array
from srl.runtime.guard.braking import State, brake, stop_phases, stop_range

STEP: Final = 0.01  # m that a limb may move between two samples of its stop
MOST: Final = 24  # samples of a stop
SHARES: Final = (1.0, 0.5)  # of the way from braking to the command that the guard tries
OLDEST: Final = 0.25  # s: a measurement isn't compared with commands older than the lag and this


def stop_time(velocity: Sequence[float], A: Sequence[float]) -> float:
    """s that a stop on the path takes: T = max |v_i|/A_i."""
    return max(map(lambda v, a: abs(v) / a, velocity, A), default=0.0)


def brake_together(states: Sequence[State], A: Sequence[float], J: Sequence[float], dt: float) -> list[State]:
    """The states after dt seconds of the stop S of the module's text."""
    if not isinf(min(J)):
        return [brake(state, a, j, dt) for state, a, j in zip(states, A, J, strict=True)]
    T = stop_time([v for _, v, _ in states], A)
    if dt >= T:
        return [(p + v * T / 2, 0.0, 0.0) for p, v, _ in states]
    left = 1.0 - dt / T
    return [(p + v * dt * (1.0 + left) / 2, v * left, -v / T) for p, v, _ in states]


class VerifiedStop:
    """Asks the clearance for one guard.

    Attributes:
        held: in this cycle no command was accepted, and the limb brakes or waits.
        waited: this cycle came so late that the limb has come to rest at its last command; the guard sets it.
        elapsed: s since the cycle before; the guard sets it.
        holds: number of such cycles.
        margin: m, of the motion that was judged last in this cycle; NaN if none was.
        error: what the clearance raised, in words; empty if nothing.
    """

    def __init__(
        self, clearance: Clearance, lag: float, timeout: float, tracking: Array, acceleration: Sequence[float],
        jerk: Sequence[float], goes_on: float = 0.0, least_lag: float = 0.0, late: float = inf,
    ) -> None:  # fmt: skip
        """
        Args:
            clearance: the judge, bound.
            lag: s, the longest time from a command until the limb is there.
            timeout: s, by which a stop may be carried out late, at least a period.
            tracking: (n,) rad or m, by which the limb may be beside what was commanded within the lag.
            acceleration, jerk: (n,) the guard's limits; the jerk may be infinite.
            least_lag: s, the shortest lag of any joint.
            goes_on: s, for which the limb goes on at an accepted velocity before its stop begins; 0 for positions.
            late: s; in a longer cycle the limb has waited at its last command; infinite for velocities.
        """
        self.clearance, self.lag, self.timeout, self.goes_on = clearance, lag, timeout, goes_on
        self.late, self.waited, self.elapsed = late, False, 0.0
        self.held, self.holds = False, 0
        self.margin = nan
        self.error = ""
        self.age = 0.0  # s, of the measured position
        self._usable = self._lost = False
        self._A, self._J = list(acceleration), list(jerk)
        self._tracking: list[float] = tracking.ravel().tolist()
        self._apart = max(lag - least_lag, 0.0) / 2  # s, of a joint from the middle of the lags
        self._faster = np.array(self._A) * lag
        self._spread = np.array(self._A) * max(lag - least_lag, 0.0)
        self._reach: list[float] = clearance.reach.ravel().tolist()
        n = len(self._A)
        self._path, self._until = np.zeros((MOST + 4, n)), np.zeros(MOST + 4)
        self._velocity, self._slack = np.zeros(n), np.array(self._tracking)
        self._beside = np.zeros(n)  # by which the limb is beside its commands, where that is more than `tracking`
        self._past: deque[tuple[float, list[float]]] = deque()  # s, what was applied; the newest last

    @property
    def why(self) -> str:
        """What was objected to, for people."""
        return self.error or self.clearance.why()

    @property
    def usable(self) -> bool:
        """The clearance can use its inputs in this cycle."""
        return self._usable

    def begin(self, now: int, stamps: Mapping[str, int], age: float) -> None:
        """Takes the inputs, once a cycle.

        Args:
            now, stamps: as `Clearance.begin`.
            age: s, of the measured position.
        """
        self.held, self.margin, self.error, self.age = False, nan, "", age
        self._lost = False
        try:
            self._usable = self.clearance.begin(now, stamps)
        except Exception as error:  # a defect of a clearance must let nothing pass
            self._failed(error)

    def unmeasured(self) -> None:
        """Nothing is clear in this cycle: where the limb is isn't known."""
        self._usable, self._lost = False, True

    def restart(self, applied: list[float]) -> None:
        """The limb is at rest at what is applied."""
        self._past.clear()
        self._past.append((0.0, applied))
        self._slack[:] = self._tracking
        self._beside[:] = 0.0

    def compare(self, applied: list[float], measured: list[float] | None, dt: float) -> None:
        """Takes what is measured for the slack, where the limb is farther from its commands than `tracking`.

        A limb that is late by up to the lag was commanded to where it is within that time. What is outside the range
        of these commands is error: a servo that is later than said, a load, a hand that holds the limb.

        Args:
            applied: what was applied in the cycle before.
            measured: where the limb is, `age` ago; None if nothing measures it.
            dt: s since the cycle before.
        """
        past = self._past
        now = past[-1][0] + dt if past else 0.0
        past.append((now, applied))
        compared = self.lag + min(self.age, OLDEST)
        kept = max(compared, self.lag + self.timeout if self.clearance.watched else 0.0)
        while len(past) > 1 and now - past[1][0] > kept:
            past.popleft()
        if measured is not None:
            # The last one before the span belongs to it.
            first = max((i for i, (t, _) in enumerate(past) if now - t > compared), default=0)
            values = np.array([each for _, each in past][first:])
            beside = np.array(measured) - np.clip(measured, values.min(axis=0), values.max(axis=0))
            np.maximum(np.abs(beside), self._tracking, out=self._slack)
            self._beside[:] = np.where(np.abs(beside) > self._tracking, beside, 0.0)

    def widen(self, slack: Sequence[float]) -> None:
        """Sets the slack to `tracking` and this, (n,) rad or m: for what isn't commanded as a position."""
        np.add(self._tracking, slack, out=self._slack)

    def occupy(self, states: list[State], before: Sequence[Sequence[float]] | None = None) -> None:
        """Tells where the limb may be from now on, at the end of a cycle, if another clearance wants to know.

        Args:
            states: what is applied, from which the limb may stop; for a velocity, with the positions at which it does.
            before: (k, n) rad or m, where else it may be. None: where it was commanded within the lag and `timeout`.
        """
        clearance = self.clearance
        if not clearance.watched:
            return
        if self._lost:
            clearance.extent = None
            return
        if isinf(min(self._J)):
            half = stop_time([v for _, v, _ in states], self._A) / 2
            ends = [[p for p, _, _ in states], [p + v * half for p, v, _ in states]]
        else:
            joints = zip(states, self._A, self._J, strict=True)
            low, high, _ = zip(*(stop_range(state, a, j) for state, a, j in joints), strict=True)
            ends = [[p for p, _, _ in states], list(low), list(high)]
        if before is None:
            before = [each for _, each in self._past]
        all_ = np.array([*ends, *before])
        clearance.extent = all_.min(axis=0) - self._slack, all_.max(axis=0) + self._slack

    def choose(
        self,
        states: list[State],
        wanted: list[State],
        dt: float,
        within: Callable[[list[State]], bool],
        origin: list[float] | None = None,
    ) -> list[State]:
        """The states to apply next: `wanted`, part of the way there, or braking.

        A mixture of two motions that keep bounds on velocity, acceleration and jerk keeps them, too.

        Args:
            states: what is applied; for a velocity, with the positions at which it is obeyed.
            wanted: what the guard would apply.
            dt: s from the one to the other.
            within: whether the joints keep their own limits, if the limb stops as in the module's text.
            origin: where the limb is now, if it isn't the position in `states`.
        """
        braked = brake_together(states, self._A, self._J, dt)
        if wanted == states and not any(v or a for _, v, a in states):
            if self._usable:
                self._is_clear(states, wanted, dt, origin)  # for the margin: a limb that rests needs nobody's leave
            return wanted
        if self._usable:
            for share in (*SHARES, *self._creep(states, wanted, dt)):
                tried = wanted if share == 1.0 else _mixed(braked, wanted, share)
                if within(self._later(tried)) and self._is_clear(states, tried, dt, origin):
                    return tried
        self.held = True
        self.holds += 1
        return self.braked(states, dt)

    def braked(self, states: list[State], dt: float) -> list[State]:
        """The states after dt of the stop that was accepted; at rest, where it came too late to hold."""
        braked = brake_together(states, self._A, self._J, dt)
        if not self.waited or (self._usable and self._is_clear(states, braked, dt, None)):
            return braked
        if any(v for _, v, _ in states):
            self.held = True
        return [(p, 0.0, 0.0) for p, _, _ in states]

    def _creep(self, states: list[State], wanted: list[State], dt: float) -> tuple[float, ...]:
        """The share of the way at which a limb that was at rest creeps; none if it creeps anyway."""
        speed = sum(map(mul, self._reach, self._speeds(states, wanted, dt)))
        most = self.clearance.creep * (1.0 - 1e-9)
        return (most / speed,) if 0.0 < most < speed else ()

    def _is_clear(self, states: list[State], tried: list[State], dt: float, origin: list[float] | None) -> bool:
        """Asks about the motion from `states` to `tried` and to rest."""
        path, until, m = self._path, self._until, 0
        if origin is not None:
            path[0], until[0], m = origin, 0.0, 1
        path[m], until[m] = [p for p, _, _ in states], self.lag
        m += 1
        if self.goes_on:
            path[m], until[m] = [p for p, _, _ in tried], self.lag + dt
            m += 1
        end = m + self._stop(self._later(tried), m)
        until[m:end] += self.lag + (self.goes_on + dt if self.goes_on else max(self.timeout, dt))
        self._velocity[:] = list(map(max, (abs(v) for _, v, _ in states), self._speeds(states, tried, dt)))
        try:
            slack = self._slack + self._apart * (self._velocity + self._faster)
            rates = None
            if origin is None and isinf(min(self._J)):  # the stop is straight, and begins where the step ends
                (p, v, _), (end_p, end_v, _) = (np.array(each).T for each in (states, tried))
                rates = np.array([v, (end_p - p) / dt, end_v])
            motion = Braking(path[:end], until[:end], self._velocity, slack, rates, self._spread)
            clear = bool(self.clearance.clear(motion))
            self.margin = self.clearance.margin
            if clear and self.margin < 0 and self._beside.any():
                # It creeps from what is too near. What pushed the limb aside may be on its other side: both must hold.
                clear = bool(self.clearance.clear(replace(motion, path=path[:end] + self._beside)))
            return clear
        except Exception as error:
            self._failed(error)
            return False

    def _later(self, states: list[State]) -> list[State]:
        """Where the stop begins at the latest."""
        return [(p + v * self.goes_on, v, a) for p, v, a in states] if self.goes_on else states

    def _speeds(self, states: list[State], tried: list[State], dt: float) -> list[float]:
        """The largest speed of each element on the way from `states` to `tried`, and in the stop from there.

        With a bounded jerk it may be faster yet for a while in the stop. A step may begin and end at rest.
        """
        joints = zip(states, tried, self._A, self._J, strict=True)
        return [
            max(abs(end[0] - begin[0]) / dt, abs(end[1]) if isinf(j) else stop_range(end, a, j)[2])
            for begin, end, a, j in joints
        ]

    def _stop(self, states: list[State], m: int) -> int:
        """Fills the path from sample m on with the stop from these states. Returns how many samples it has."""
        p, v = np.array([s[0] for s in states]), np.array([s[1] for s in states])
        smooth = not isinf(min(self._J))
        if smooth:
            phases = [stop_phases(s[1], s[2], a, j) for s, a, j in zip(states, self._A, self._J, strict=True)]
            T = max(sum(duration for duration, _ in each) for each in phases)
        else:
            T = stop_time(v.tolist(), self._A)
        self._path[m], self._until[m] = p, 0.0
        if T <= 0.0:
            return 1
        k = MOST if smooth else min(ceil(float(np.abs(v) @ self._reach) * T / 2 / STEP), MOST)
        shares = np.arange(1, k + 1) / k
        times = T * (shares if smooth else 1.0 - np.sqrt(1.0 - shares))  # equal steps on a straight path
        if smooth:
            for i, t in enumerate(times.tolist(), m + 1):
                self._path[i] = [s[0] for s in brake_together(states, self._A, self._J, t)]
        else:
            self._path[m + 1 : m + 1 + k] = p + shares[:, None] * (v * (T / 2))
        self._until[m + 1 : m + 1 + k] = times
        return 1 + k

    def _failed(self, error: Exception) -> None:
        self._usable, self.margin, self.error = False, nan, f"the clearance failed: {type(error).__name__}: {error}"


def _mixed(braked: list[State], wanted: list[State], share: float) -> list[State]:
    rest = 1.0 - share
    return [
        (rest * b[0] + share * w[0], rest * b[1] + share * w[1], rest * b[2] + share * w[2])
        for b, w in zip(braked, wanted, strict=True)
    ]
