"""How a joint comes to rest: the fastest stop from position p, velocity v and acceleration a.

One degree of freedom, acceleration bounded by A and jerk by J (infinite: the acceleration may jump). The
fastest stop has a property the guard lives by: a state on the way of a stop stops at the same place. So where
a stop is possible within the limits, it stays possible while braking.
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

    Ramp the acceleration down to -peak, hold it there, ramp it back to zero; in the mirror where v, left to
    itself with the acceleration ramped out, would end negative.
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
    """What the fastest stop passes through: lowest position, highest position, highest speed."""
    p, v, a = state
    if isinf(J):
        end = p + v * abs(v) / (2 * A)
        return (p, end, v) if v >= 0 else (end, p, -v)
    end = brake(state, A, J, inf)[0]
    low, high, speed = min(p, end), max(p, end), abs(v)
    if v * a > 0:  # it goes on gaining speed while the acceleration is ramped out
        speed = abs(v) + a * a / (2 * J)
    elif v * a < 0:
        after = abs(a) * abs(a) / (2 * J) - abs(v)  # speed it will have in the other direction
        if after > 0:  # it turns round on the way, at time t
            speed = max(speed, after)
            t = (abs(a) - sqrt(2 * J * after)) / J
            turn = p + t * (v + t * (a / 2 - copysign(J, a) * t / 6))
            low, high = min(low, turn), max(high, turn)
    elif v == 0 and a != 0:
        speed = a * a / (2 * J)
    return low, high, speed


def stoppable(distance: float, A: float, J: float) -> float:
    """A speed from which (at zero acceleration) a joint stops within `distance`; exact for infinite J.

    With finite J the distance v^2/2A + vA/2J is exact above v = A^2/J and too long below it: the safe side.
    """
    if distance <= 0:
        return 0.0
    if isinf(J):
        return sqrt(2 * A * distance)
    ramp = A * A / (2 * J)
    return sqrt(ramp * ramp + 2 * A * distance) - ramp
