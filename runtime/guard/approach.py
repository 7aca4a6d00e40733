"""The fastest motion of a joint to rest at zero, where its jerk is unbounded."""

from __future__ import annotations

from math import inf, sqrt


def approach(x: float, v: float, slowest: float, fastest: float, A: float, dt: float) -> tuple[float, float]:
    """Position (rad or m) and velocity (per s) after dt on the fastest motion to rest at zero.

    A double integrator is fastest with all its acceleration in one direction, then all in the other; between them
    it keeps a bound of the velocity, if it reaches one. If the fastest stop from here ends below zero, the first is
    upwards. A velocity beyond its bound comes back to it first. Where the bound is zero, that is all.

    Args:
        x, v: position and velocity now, rad and rad/s, or m and m/s.
        slowest, fastest: bounds of the velocity, below and above zero, or zero, rad/s or m/s.
        A: bound of the acceleration, above zero, rad/s^2 or m/s^2.
        dt: s.
    """
    sign, top = 1.0, fastest
    if x + v * abs(v) / (2 * A) > 0:
        sign, x, v, top = -1.0, -x, -v, -slowest
    peak, a = top, -A
    if v <= top:
        peak, a = min(sqrt(max(v * v / 2 - A * x, 0.0)), top), A
    begin = max((peak - v) / a, 0.0)
    if dt < begin:
        return sign * (x + dt * (v + a * dt / 2)), sign * (v + a * dt)
    x, dt = x + begin * (v + peak) / 2, dt - begin
    end = peak / A
    if peak == top:
        cruise = max(-(x + peak * end / 2) / peak, 0.0) if peak > 0 else inf
        if dt < cruise:
            return sign * (x + peak * dt), sign * peak
        dt -= cruise
    left = end - dt
    return (sign * (-A * left * left / 2), sign * (A * left)) if left > 0 else (0.0, 0.0)
