"""The fastest stop of a joint from position p, velocity v and acceleration a.

The joint has one degree of freedom. Its acceleration is bounded by A and its jerk by J (infinite: the
acceleration may jump). The guard relies on one property of the fastest stop: from any state on the way, the
fastest stop ends at the same place. So if a stop is possible within the limits, it stays possible while braking.
"""

from __future__ import annotations

from math import copysign, inf, isinf, sqrt
from typing import NamedTuple

State = tuple[float, float, float]  # position, velocity, acceleration


class Bounds(NamedTuple):
    """Limits of one joint's motion: velocity, acceleration, jerk (may be infinite)."""

    V: float
    A: float
    J: float


def stop_phases(v: float, a: float, A: float, J: float) -> tuple[tuple[float, float], ...]:
    """The three phases of the fastest stop for finite J, as (duration s, jerk).

    The acceleration is ramped down to -peak, held there, and ramped back to zero. All signs are reversed if v
    would become negative when only the acceleration is ramped to zero.
    """
    sign = 1.0 if v + a * abs(a) / (2 * J) >= 0 else -1.0
    v, a = sign * v, sign * a
    peak = sqrt(max(J * v + a * a / 2, 0.0))
    hold = 0.0
    if peak > A:
        peak = A
        hold = max((v + (a * a - 2 * A * A) / (2 * J)) / A, 0.0)
    return (max(a + peak, 0.0) / J, -sign * J), (hold, 0.0), (peak / J, sign * J)


def brake(state: State, A: float, J: float, dt: float) -> State:
    """The state after dt seconds of the fastest stop."""
    p, v, a = state
    if isinf(J):
        t = abs(v) / A
        if t <= dt:
            return p + v * t / 2, 0.0, 0.0
        a = -copysign(A, v)
        return p + v * dt + a * dt * dt / 2, v + a * dt, a
    for duration, j in stop_phases(v, a, A, J):
        t = min(duration, dt)
        p, v, a = p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j
        dt -= t
        if t < duration:
            return p, v, a
    return p, 0.0, 0.0


def stop_range(state: State, A: float, J: float) -> tuple[float, float, float]:
    """The range of the fastest stop: lowest position, highest position, highest speed."""
    p, v, a = state
    if isinf(J):
        end = p + v * abs(v) / (2 * A)
        return (p, end, v) if v >= 0 else (end, p, -v)
    end = brake(state, A, J, inf)[0]
    low, high, speed = min(p, end), max(p, end), abs(v)
    if v * a > 0:  # the speed still increases while the acceleration is ramped to zero
        speed = abs(v) + a * a / (2 * J)
    elif v * a < 0:
        after = abs(a) * abs(a) / (2 * J) - abs(v)  # speed that it will reach in the other direction
        if after > 0:  # it reverses its direction, at time t
            speed = max(speed, after)
            t = (abs(a) - sqrt(2 * J * after)) / J
            turn = p + t * (v + t * (a / 2 - copysign(J, a) * t / 6))
            low, high = min(low, turn), max(high, turn)
    elif v == 0 and a != 0:
        speed = a * a / (2 * J)
    return low, high, speed


def stoppable(distance: float, A: float, J: float) -> float:
    """A speed from which a joint with zero acceleration stops within `distance`; exact for infinite J.

    With finite J the distance v^2/2A + vA/2J is exact above v = A^2/J. Below it is too long, on the safe side.
    """
    if distance <= 0:
        return 0.0
    if isinf(J):
        return sqrt(2 * A * distance)
    ramp = A * A / (2 * J)
    return sqrt(ramp * ramp + 2 * A * distance) - ramp
