"""The guard of torque commands."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np

from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array, Limits, Stop
from srl.runtime.guard.base import CommandGuard, finite

ZONE = 0.05  # of a joint's range: where the barrier's spring reaches the effort limit
FADE = 0.25  # of the velocity limit: range below it in which effort that would exceed it fades out
HOLD_TIME = 0.2  # s: damping divided by stiffness of the hold
LAG = 4  # periods of delay from a velocity to its torque that a damped joint surely tolerates, at half its margin
STILL = 0.02  # of the velocity limit: a slower joint is at rest
SPAN = 0.1  # s of damping at least in which a joint's own motion becomes slower by SLOWS, or something else moves it
LONGEST_SPAN = 1.0  # s: what hardly damps doesn't end a stop by being waited for
CONFIRM = 3  # samples in a row in which a joint's motion is over before it is held: one sample alone shows nothing
SLOWS = 0.05  # share of the mean speed
TAKES = 2.0  # of I/d at least, too: a joint that moves 20 times its least inertia slows by 2 SLOWS in that


class Barrier(NamedTuple):
    """One joint's bounds of a torque relative to gravity compensation; see `TorqueGuard`."""

    E: float
    V: float
    lower: float
    upper: float
    slope: float  # N m s/rad, of the velocity limit's bound
    k: float  # N m/rad; 0 without position limits
    d: float  # N m s/rad
    A: float

    def range(self, q: float, qd: float) -> tuple[float, float]:
        """The torque range that velocity limit and barrier allow, N m."""
        # Plain comparisons: min and max cost four times as much.
        E, V, lower, upper, slope, k, d, A = self
        least, most = -slope * (V + qd), slope * (V - qd)
        if k > 0.0:
            way, drag = qd * abs(qd) / (2 * A), 2 * d * qd  # braking distance, damping torque
            outward = k * (upper - q - way) - drag if qd > 0 else k * (upper - q)
            inward = k * (lower - q - way) - drag if qd < 0 else k * (lower - q)
            most = outward if outward < most else most
            least = inward if inward > least else least
        least = -E if least < -E else E if least > E else least
        most = -E if most < -E else E if most > E else most
        return least, most


class Span:
    """How fast a joint is on average in a span, and in the one before: a measured speed is too coarse by itself.

    Attributes:
        started: it has been given a speed.
        back_driven: it isn't becoming slower, so something else moves it.
    """

    __slots__ = ("_before", "_length", "_time", "_way", "back_driven", "started")

    def __init__(self, length: float) -> None:
        """`length`: s, of a span."""
        self.started = self.back_driven = False
        self._length = length
        self._way = self._time = 0.0
        self._before = inf

    def add(self, speed: float, dt: float, damped: bool) -> None:
        """Takes a cycle of dt s at this speed, rad/s. `damped`: damping acted as it is meant to."""
        self.started = True
        if not damped:
            self.back_driven, self._before, self._way, self._time = False, inf, 0.0, 0.0
            return
        self._way, self._time = self._way + speed * dt, self._time + dt
        if self._time >= self._length:
            mean = self._way / self._time
            self.back_driven = mean >= (1 - SLOWS) * self._before
            self._before, self._way, self._time = mean, 0.0, 0.0


class TorqueGuard(CommandGuard):
    """Limits a torque by the effort, its change by the effort rate, and keeps joints away from their limits.

    All torques are relative to the gravity compensation g, if it is bound, so that the guard neither opposes
    nor removes it. With effort limit E and velocity limit V, the damping is d = E/V: full effort at full speed.
    It is at most I/(8 dt), where I is the least inertia that the joint moves. More damping would make a joint
    ring if its torque acts some periods after its velocity was measured.

    The barrier is a one-sided spring and damper with stiffness k = E/(ZONE range) and damping 2d. For qd > 0,
    tau - g <= k (upper - q - qd^2/2A) - 2d qd, and likewise at the lower limit. Each side is kept within
    [-E, E]: beyond a limit the allowed torque points inwards. The barrier does not reduce a torque that does not
    push outwards. A is the acceleration limit, if given: the deceleration that the effort can surely produce.
    Without it a joint that is heavy for its effort overruns the barrier. The velocity limit works in the same
    way: tau - g <= E (V - qd)/(FADE V).

    Stops: `damp` applies -d qd. `limp` applies only g. `hold` damps, then adds a spring to the position where
    each joint's own motion was over, with stiffness d/HOLD_TIME. `brake` and `retract` act as `hold`. All stops stay
    within effort and rate.

    A joint's own motion is over when it is still, or no slower on average in a span of damping than in the one before:
    then a hand or a load moves it on. A span is SPAN, and longer where damping takes longer: at a low rate, or where
    the effort is small. So `damp` is complete while a hand leads the limb, and `hold` doesn't creep under
    a steady force. What a hand lets go moves by itself again. A joint is held once its motion is over in CONFIRM
    samples in a row, at the median of where it was in them: so no single sample, however wrong, moves it.
    """

    needs = ("velocity", "effort", "effort_rate", "inertia")
    may_be_zero = ("effort", "effort_rate")

    def _prepare(self, limits: Limits) -> None:
        if (limits.lower is None) != (limits.upper is None):
            missing = "lower" if limits.lower is None else "upper"
            raise WiringError(
                self.place,
                f"the joint-limit barrier needs both position limits, and {missing} is missing",
                f"Add {missing} to {self.place} in the profile",
            )
        self._g = [0.0] * self.size  # the newest finite value
        self._held: list[float | None] = [None] * self.size
        self._q, self._qd = [0.0] * self.size, [0.0] * self.size  # measured values, read by `_sensed`
        self._barriers = [self._barrier(i) for i in range(self.size)]
        self._lengths = [
            min(max(SPAN, TAKES * inertia / max(b.d, 1e-9)), LONGEST_SPAN)
            for inertia, b in zip(self.inertia, self._barriers, strict=True)
        ]
        self._spans = list(map(Span, self._lengths))
        self._places: list[list[float]] = [[] for _ in range(self.size)]  # where it was while its motion is over
        self._noted: list[int | None] = [None] * self.size  # when the newest of those was measured

    def keep_clear(
        self, clearance: Clearance, lag: float, tracking: Array, timeout: float | None = None,
        least_lag: float = 0.0, period: float | None = None,
    ) -> None:  # fmt: skip
        raise WiringError(
            self.place,
            "a torque command says nothing of how the limb brakes, so nothing can keep it clear",
            "Command the limb by position or velocity, or remove `clear:`",
        )

    def _bound(self) -> None:
        if self._position is None or self._velocity is None:
            raise WiringError(
                self.place,
                "a torque command needs the measured position and velocity",
                "Use a device that measures both",
            )

    def _restart(self, position: list[float], velocity: list[float]) -> None:
        self._release()
        if self._was_active and finite(self.applied.ravel().tolist()):
            self._read_gravity()
            return  # a stop may press against a load: to let go of that at once would be a jump
        self._g = [0.0] * self.size
        self._read_gravity()
        start = [min(max(g, -E), E) for g, E in zip(self._g, self.max_effort, strict=True)]
        self.applied.reshape(-1)[:] = start

    def _restart_from(self, sent: list[float], which: list[int]) -> None:
        for i in which:
            self.applied.flat[i] = sent[i]

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        self._release()
        self._read_gravity()
        self._apply(desired, dt)

    def _halt(self, category: Stop, dt: float) -> None:
        self._read_gravity()
        unmeasured = not self._sensed()
        limp = unmeasured or category is Stop.LIMP
        q, qd = self._q, self._qd
        if limp:
            self._release()  # by the next stop, or when measurements return, it may be far away, and move otherwise
        out = []
        for i, (g, barrier) in enumerate(zip(self._g, self._barriers, strict=True)):
            if limp:
                out.append(g)
                continue
            self._note(i, q[i])
            d = barrier.d
            tau = -d * qd[i]
            if category is Stop.DAMP:
                self._held[i] = None  # it moves on: a hold after this is at another place
            else:
                held = self._held[i]
                if held is None and self._confirmed(i):
                    held = self._held[i] = sorted(self._places[i])[CONFIRM // 2]
                if held is not None:
                    tau += d / HOLD_TIME * (held - q[i])
            out.append(g + tau)
        self._apply(out, dt, sighted=not unmeasured)
        if limp:
            applied = self.applied.ravel().tolist()
            self.at_rest = all(abs(x - t) <= self.tolerance for x, t in zip(applied, out, strict=True))
        else:
            self._watch(out, dt)
            self.at_rest = all(map(self._confirmed, range(self.size)))

    def _release(self) -> None:
        """Forgets what a stop holds, and how it went."""
        if self._spans[0].started:
            self._held, self._spans = [None] * self.size, list(map(Span, self._lengths))
            self._places = [[] for _ in range(self.size)]

    def _note(self, i: int, q: float) -> None:
        """Keeps where a joint was in the newest samples in which its own motion is over."""
        places = self._places[i]
        if self._over(i):
            if self.stamp is None or self.stamp != self._noted[i]:
                places.append(q)
                self._noted[i] = self.stamp
            del places[:-CONFIRM]
        else:
            places.clear()

    def _confirmed(self, i: int) -> bool:
        """Whether a joint's own motion is over, by more than one sample."""
        return len(self._places[i]) >= CONFIRM

    def _over(self, i: int) -> bool:
        """Whether a joint's own motion is over; see the class's docstring."""
        return abs(self._qd[i]) <= STILL * self._barriers[i].V or self._spans[i].back_driven

    def _watch(self, wanted: list[float], dt: float) -> None:
        """Follows how fast each joint is under the torque that is wanted."""
        applied = self.applied.ravel().tolist()
        for span, tau, asked, w in zip(self._spans, applied, wanted, self._qd, strict=True):
            # A torque that isn't: the rate still keeps the damping back, or the barrier acts.
            span.add(abs(w), dt, abs(tau - asked) <= self.tolerance)

    def _apply(self, wanted: list[float], dt: float, sighted: bool = True) -> None:
        out = []
        joints = zip(self._barriers, self._q, self._qd, self._g, self.max_effort_rate, strict=True)
        for asked, last, (barrier, q, qd, g, rate) in zip(wanted, self.applied.ravel().tolist(), joints, strict=True):
            E, tau = barrier.E, asked
            if sighted:
                least, most = barrier.range(q, qd)
                left = asked - g
                left = least if left < least else left
                tau = (most if left > most else left) + g
            tau = -E if tau < -E else E if tau > E else tau
            step = rate * dt
            tau = last - step if tau < last - step else tau
            out.append(last + step if tau > last + step else tau)
        self.applied.reshape(-1)[:] = out

    def _barrier(self, i: int) -> Barrier:
        E, V, lower, upper = self.max_effort[i], self.max_velocity[i], self.lower[i], self.upper[i]
        ends = -inf < lower and upper < inf
        k = E / (ZONE * (upper - lower)) if ends else 0.0
        d = min(E / V, self.inertia[i] / (2 * LAG * self.dt))
        return Barrier(E, V, lower, upper, E / (FADE * V), k, d, self.max_acceleration[i])

    def _sensed(self) -> bool:
        assert self._position is not None
        assert self._velocity is not None
        self._q, self._qd = self._position.ravel().tolist(), self._velocity.ravel().tolist()
        return not self.unmeasured and finite(self._q) and finite(self._qd)

    def _read_gravity(self) -> None:
        if self._gravity is not None and np.isfinite(self._gravity).all():
            self._g = self._gravity.ravel().tolist()
