"""The last limiter before the wire: it sends no setpoint that would make the robot stop. Pure, one call per ms.

The guard limits a controller's commands in the loop's own time. The robot counts in packets: from one packet to the
next a torque may change by 1 N m, however much time has passed, and a motion has bounded jerk. The next setpoint is
computed from the robot's own record of the last packet it took (tau_J_d, or q_d, dq_d, ddq_d). So if a packet is lost
and the robot replaces it, the next one isn't a jump. The robot replaces a lost packet of a motion by continuing with
the same acceleration: where packets are often lost, each is planned to last until the next one arrives. And whatever
the packets before were, each leaves so much room below the velocity limit that as many losses in a row as the robot
bears don't take the motion beyond it.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, isfinite, nan, sqrt
from typing import Final

import numpy as np

from srl.drivers.panda.limits import ACCELERATION, DT, JERK, TORQUE, TORQUE_RATE, RobotLimits
from srl.runtime.contracts.compiled import numbers

STEP: Final = TORQUE * TORQUE_RATE * DT  # N m from one packet to the next
_APART: Final = 2 * STEP
FOLLOW: Final = 0.02  # s: time constant for reducing a position error to the moving target
CATCH: Final = 0.5  # of the acceleration, at most, for slowing down at the end of this
LOSSES: Final = 19  # packets in a row that may be lost; one more and the robot stops whatever the motion is
HASTE: Final = 0.05  # share of the velocity, at most, beyond the command's own: the guard may have slowed the arm
_SAME: Final = 7e-8  # relative: tolerance for a float32 state that shows the value sent
_FORGET: Final = 0.98  # factor per packet: how fast the expectation of further losses decays


class TorqueLimiter:
    """Limits torques to the effort limit, and their change from the last packet that the robot took.

    In C where it can be (native/panda.c); `step` is the specification.

    Attributes:
        sent: N m (7,), what was sent last; NaN before the first.
        limits: (9,), what C needs to know: `STEP`, how far apart two values may be to stay near to both, and the
            effort of each joint, N m.
    """

    def __init__(self, limits: RobotLimits) -> None:
        self._effort = limits.effort
        self.sent = np.full(7, nan)
        self.limits = numbers(STEP, _APART, limits.effort)

    def start(self) -> None:
        """Starts a motion."""
        self.sent.fill(nan)

    def step(self, wanted: Sequence[float], taken: Sequence[float]) -> list[float]:
        """Returns the torques to send, N m (7,).

        Args:
            wanted: N m (7,), in addition to the robot's own gravity compensation; a non-finite one keeps `taken`.
            taken: N m (7,), the state's tau_J_d.
        """
        if not isfinite(sum(wanted)):
            wanted = [w if isfinite(w) else t for w, t in zip(wanted, taken, strict=True)]
        sent = []
        for w, t, s, E in zip(wanted, taken, self.sent.tolist(), self._effort, strict=True):
            # The last packet may be lost or still on its way: stay near to both values, if they aren't too far apart.
            # Before the first packet `s` is NaN, so near to none.
            near = s if -_APART < s - t < _APART else t
            low, high = (near - STEP, t + STEP) if near > t else (t - STEP, near + STEP)
            # min(max(w, low, -E), high, E): calls of min and max take three times as long
            low, high = low if low > -E else -E, high if high < E else E
            bounded = low if w < low else w
            sent.append(high if bounded > high else bounded)
        self.sent[:] = sent
        return sent


class MotionLimiter:
    """Limits a joint motion in velocity, acceleration and jerk, and keeps enough distance for braking.

    Attributes:
        q, dq, ddq: the values sent last: rad, rad/s, rad/s^2 (7,).
    """

    def __init__(self, limits: RobotLimits) -> None:
        self._limits = limits
        self._acceleration = [ACCELERATION * a for a in limits.acceleration]
        self._jerk_step = [JERK * j * DT for j in limits.jerk]
        self.q, self.dq, self.ddq = [0.0] * 7, [0.0] * 7, [0.0] * 7
        self._last: list[float] | None = None
        self._lasts = DT  # s that a packet is expected to stay in use

    def start(self, q: Sequence[float]) -> None:
        """Starts a motion at rest at the robot's q_d (rad)."""
        self.q, self.dq, self.ddq = list(q), [0.0] * 7, [0.0] * 7
        self._last = None
        self._lasts = DT

    def take(self, q: Sequence[float], dq: Sequence[float], ddq: Sequence[float], ticks: int = 1) -> None:
        """Takes the robot's record (q_d, dq_d, ddq_d) of the last packet; if it agrees, the sent values are more exact.

        `ticks`: ms of the robot's time since the last packet.
        """
        self._lasts = max(min(ticks, 20) * DT, DT + _FORGET * (self._lasts - DT))
        self.q = _agreed(q, self.q)
        self.dq = _agreed(dq, self.dq)
        self.ddq = _agreed(ddq, self.ddq)

    def velocity(self, wanted: Sequence[float]) -> list[float]:
        """Returns the velocities to send, rad/s (7,): as near to `wanted` as the limits allow."""
        late = 2 * (self._lasts - DT)
        for i, v in enumerate(self.dq):
            least, most = self._limits.bounds(i, self.q[i], v, late)
            target = min(max(wanted[i] if isfinite(wanted[i]) else 0.0, least), most)
            step, A, a = self._jerk_step[i], self._acceleration[i], self.ddq[i]
            ahead = approach(target - v, step, self._lasts)
            ahead = min(max(ahead, -room(v - least, step)), room(most - v, step))
            ahead = min(max(ahead, a - step, -A), a + step, A)
            self.dq[i], self.ddq[i] = v + ahead * DT, ahead
            self.q[i] += self.dq[i] * DT
        return self.dq

    def position(self, wanted: Sequence[float]) -> list[float]:
        """Returns the positions to send, rad (7,): they follow `wanted` within the limits, without a lasting lag."""
        last = self._last or list(wanted)
        self._last = [w if isfinite(w) else before for w, before in zip(wanted, last, strict=True)]
        velocity, follow = [], max(FOLLOW, 4 * self._lasts)
        for w, before, q, A, V in zip(
            self._last, last, self.q, self._limits.acceleration, self._limits.velocity, strict=True
        ):
            haste = min(max(catch_up(before - q, CATCH * A, follow), -HASTE * V), HASTE * V)
            velocity.append((w - before) / DT + haste)
        self.velocity(velocity)
        return self.q

    @property
    def at_rest(self) -> bool:
        """Whether the commanded motion is at rest."""
        return max(map(abs, self.dq)) < 1e-4 and max(map(abs, self.ddq)) < 1e-1


def approach(error: float, step: float, dt: float = DT) -> float:
    """Returns the next packet's acceleration with which a velocity reaches its target fastest without overshoot.

    With n packets left the accelerations are x, x - step, ..., x - (n - 1) step and add up to error / dt.

    Args:
        error: target velocity minus the present one.
        step: the change of acceleration from packet to packet.
        dt: s that one packet lasts.
    """
    s = abs(error) / (step * dt)
    if s <= 1:
        return error / dt
    n = ceil((sqrt(1 + 8 * s) - 1) / 2)
    x = step * (s + n * (n - 1) / 2) / n
    return x if error > 0 else -x


def room(distance: float, step: float) -> float:
    """Returns the largest acceleration x that a packet may have so far below a velocity limit.

    The robot goes on with x for all `LOSSES`; then x - step, x - 2 step, ... x - n step >= 0 end the acceleration at
    the limit: x (LOSSES + n + 1) - step n (n + 1) / 2 = distance / DT.

    Args:
        distance: rad/s from the velocity to its limit; 0 beyond it gives 0.
        step: the change of acceleration from packet to packet.
    """
    total, b = max(distance, 0.0) / DT, LOSSES + 0.5
    n = int(sqrt(b * b + 2 * total / step) - b)
    return (total + step * n * (n + 1) / 2) / (LOSSES + n + 1)


def catch_up(error: float, brake: float, follow: float = FOLLOW) -> float:
    """Returns the velocity that removes a position error: proportional if small, else limited so `brake` can stop it.

    Args:
        error: rad.
        brake: rad/s^2.
        follow: s, the time constant.
    """
    small = brake * follow * follow
    size = abs(error)
    speed = size / follow if size <= small else sqrt(brake * (2 * size - small))
    return speed if error > 0 else -speed


def _agreed(state: Sequence[float], sent: list[float]) -> list[float]:
    for seen, own in zip(state, sent, strict=True):
        if abs(own - seen) > _SAME * abs(seen) + 1e-12:
            return list(state)
    return sent
