"""The fastest way to rest, where the acceleration may jump: what ruckig plans for an infinite jerk.

In closed form, as it is asked for each joint in nearly every cycle; ruckig is the judge in the tests.
"""

from __future__ import annotations

from math import sqrt

from runtime.guard.braking import State


def approach(x: float, v: float, A: float, slowest: float, fastest: float, dt: float) -> State:
    """The state after dt of the fastest way from position x, velocity v to rest at zero.

    Accelerate, go on at the velocity limit, brake.

    Args:
        x, v: present position and velocity.
        A: greatest acceleration either way, > 0.
        slowest, fastest: bounds of the velocity, < 0 and > 0; v outside is brought within at once.
        dt: s, > 0.
    """
    sign = 1.0
    if x + v * abs(v) / (2 * A) > 0:  # it would stop above zero: the mirrored way
        x, v, fastest, sign = -x, -v, -slowest, -1.0
    # (top^2 - v^2) / 2A on the way up to the top speed and top^2 / 2A on the way down make -x
    top = min(sqrt(max(v * v / 2 - A * x, 0.0)), fastest)
    turn = A if v <= top else -A
    ramp = (top - v) / turn
    if dt < ramp:
        return sign * (x + dt * (v + dt * turn / 2)), sign * (v + dt * turn), sign * turn
    x, v, dt = x + ramp * (v + top) / 2, top, dt - ramp
    cruise = max(-x / top - top / (2 * A), 0.0) if top > 0 else 0.0
    if dt < cruise:
        return sign * (x + dt * v), sign * v, 0.0
    x, dt = x + cruise * v, dt - cruise
    if dt < top / A:
        return sign * (x + dt * (v - dt * A / 2)), sign * (v - dt * A), -sign * A
    return 0.0, 0.0, 0.0
