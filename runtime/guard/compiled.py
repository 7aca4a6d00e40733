"""The guards in C (native/guards.c): the cycle in which a command is followed. Stops are Python's."""

from __future__ import annotations

from abc import abstractmethod
from math import inf

import numpy as np

from srl.runtime.contracts.compiled import NotCompiledError, RetryBackoff, Step, bind
from srl.runtime.contracts.signals import Array
from srl.runtime.guard.base import CommandGuard
from srl.runtime.guard.fast import Fast
from srl.runtime.guard.position import PositionGuard
from srl.runtime.guard.torque import TorqueGuard
from srl.runtime.guard.velocity import REACTION, VelocityGuard

_RARE = -1


def compile_guard(guard: CommandGuard, asked: Array, asked_velocity: Array | None) -> None:
    """From now on `step` and `resynchronise` of this bound guard take the C versions where they apply.

    Args:
        guard: after `bind` and `keep_clear`.
        asked, asked_velocity: the arrays that `step` will be given.

    Raises:
        NotCompiledError: nothing in C does what its limits ask for; the guard stays as it is.
    """
    if guard.verified is not None:
        raise NotCompiledError("it doesn't take `clear:`")
    made = _KINDS.get(type(guard))
    if made is None:
        raise NotCompiledError("it has no C version")
    guard.fast = made(guard, asked, asked_velocity)


class _Compiled(Fast):
    """While `_inside`, the guard's state is in arrays here; and while `_kept_since`, so is its tracker's."""

    def __init__(self, guard: CommandGuard, asked: Array, rate: Array | None) -> None:
        self._asked, self._rate, self._flag = asked, rate, False
        self._inside, self._all_taken, self._dt = False, False, 0.0
        self._tolerance, self._tracker = np.array([guard.tolerance]), guard._tracker
        self._applied = np.zeros(guard.size)  # what was applied when all had been sent
        self._backoff = RetryBackoff()
        self._step = self._bind(guard)
        self._same: Step | None = None
        if guard._sent is not None:
            self._same = bind("sent-tracker", guard._sent, guard.applied, self._applied)

    def step(self, desired: Array, desired_velocity: Array | None, dt: float) -> int:
        if desired is not self._asked or desired_velocity is not self._rate:
            self.leave()
            return _RARE
        if not self._inside and not (self._backoff.over() and self._enter()):
            return _RARE
        done = self._step(dt, self._flag)
        self._backoff.tried(done >= 0)
        if done < 0:
            self.leave()  # nothing to give back if it was a try: what Python holds meanwhile stays
        else:
            self._inside = True
        return done

    def leave(self) -> None:
        if self._inside:
            self._leave()
            self._inside = False

    def taken(self, transmitted: bool, dt: float) -> bool:
        tracker = self._tracker
        if (
            self._same is not None
            and dt <= tracker.timeout
            and (transmitted or not tracker.stalled)
            and not self._same(dt)
        ):
            tracker.stalled, tracker.false, tracker._dt = False, 0.0, dt
            self._all_taken, self._dt = True, dt
            return True
        self.tell()
        return False

    def tell(self) -> None:
        if self._all_taken:
            self._tracker.all_taken(self._applied.tolist(), self._dt)
            self._all_taken = False

    def forget(self) -> None:
        self._inside = self._all_taken = False
        self._backoff.forget()

    @abstractmethod
    def _bind(self, guard: CommandGuard) -> Step:
        """Binds the C function. Raises NotCompiledError: it doesn't do what the guard's limits ask for."""

    def _enter(self) -> bool:
        """Takes the guard's state; False: it is none that C goes on from."""
        return True

    def _leave(self) -> None:
        """Gives the guard its state back."""


class _Torque(_Compiled):
    def _bind(self, guard: CommandGuard) -> Step:
        assert isinstance(guard, TorqueGuard)
        assert guard._position is not None
        assert guard._velocity is not None
        self._guard, self._flag, self._g = guard, guard._gravity is not None, np.zeros(guard.size)
        limits = np.array(
            [[*barrier, rate] for barrier, rate in zip(guard._barriers, guard.max_effort_rate, strict=True)]
        )
        gravity = self._g if guard._gravity is None else guard._gravity
        return bind("torque-guard", self._asked, guard._position, guard._velocity, gravity, limits, self._tolerance,
                    guard.applied, self._g)  # fmt: skip

    def _enter(self) -> bool:
        self._g[:] = self._guard._g
        return True

    def _leave(self) -> None:
        self._guard._g = self._g.tolist()
        self._guard._release()


class _Velocity(_Compiled):
    def _bind(self, guard: CommandGuard) -> Step:
        assert isinstance(guard, VelocityGuard)
        self._flag = guard.held_in
        A = np.array(guard.max_acceleration)
        limits = np.stack([guard.max_velocity, A, guard.lower, guard.upper, A * REACTION * guard.dt], axis=1)
        position = np.zeros(guard.size) if guard._position is None else guard._position
        return bind("velocity-guard", self._asked, position, limits, self._tolerance, guard.applied)


class _Position(_Compiled):
    def _bind(self, guard: CommandGuard) -> Step:
        assert isinstance(guard, PositionGuard)
        if min(guard.max_jerk) < inf:
            raise NotCompiledError("it doesn't take a limit of the jerk")
        self._guard, self._flag, self._state = guard, self._rate is not None, np.zeros((guard.size, 5))
        limits = np.stack([guard.max_velocity, guard.max_acceleration, guard.lower, guard.upper], axis=1)
        rate = np.zeros(guard.size) if self._rate is None else self._rate
        return bind("position-guard", self._asked, rate, limits, self._tolerance, self._state, guard.applied,
                    guard.velocity)  # fmt: skip

    def _enter(self) -> bool:
        guard = self._guard
        if guard._beyond:  # it began outside its limits
            return False
        self._state[:, 0] = [p for p, _, _ in guard._states]
        self._state[:, 1] = [v for _, v, _ in guard._states]
        self._state[:, 2], self._state[:, 3], self._state[:, 4] = guard._targets, guard._raw, guard._rates
        return True

    def _leave(self) -> None:
        guard = self._guard
        p, v, guard._targets, guard._raw, guard._rates = self._state.T.tolist()
        guard._states = [(a, b, 0.0) for a, b in zip(p, v, strict=True)]


_KINDS: dict[type[CommandGuard], type[_Compiled]] = {
    TorqueGuard: _Torque, VelocityGuard: _Velocity, PositionGuard: _Position,
}  # fmt: skip
