"""The last line before the wire: no setpoint leaves that the robot would stop for. Pure, one call a millisecond.

The guard bounds what a controller asks for in the loop's own time. The robot counts in packets: from one to the
next a torque may change by 1 N m, whatever time has passed, and a motion has bounded jerk. Its own account of the
last packet it took (tau_J_d, or q_d, dq_d, ddq_d) is what the next is counted from, so that a lost packet, which
the robot replaces by itself, doesn't make the next one a jump. It replaces one of a motion by going on with the
same acceleration: where packets are lost often, each is made to last until the next one arrives.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, isfinite, sqrt
from typing import Final

from drivers.panda.limits import ACCELERATION, DT, JERK, TORQUE, TORQUE_RATE, RobotLimits

STEP: Final = TORQUE * TORQUE_RATE * DT  # N m from one packet to the next
FOLLOW: Final = 0.02  # s: time constant with which a position that ran ahead is caught up with
CATCH: Final = 0.5  # of the acceleration, at most, to slow down with when it has been caught up with
HASTE: Final = 0.05  # of the velocity, at most, beyond the command's own: the guard may have meant a slow arm
_SAME: Final = 7e-8  # relative: a state in float32 that shows the value sent
_FORGET: Final = 0.98  # a packet: how long losses are expected to go on


class TorqueLimiter:
    """Bounds torques by the effort limit and the change from the last packet the robot took."""

    def __init__(self, limits: RobotLimits) -> None:
        self._effort = limits.effort
        self._sent: list[float] | None = None

    def start(self) -> None:
        """A motion begins."""
        self._sent = None

    def step(self, wanted: Sequence[float], taken: Sequence[float]) -> list[float]:
        """The torques to send, N m (7,).

        Args:
            wanted: N m (7,), on top of the robot's own gravity compensation; one that isn't finite keeps `taken`.
            taken: N m (7,), the state's tau_J_d.
        """
        sent = []
        for w, t, s, E in zip(wanted, taken, self._sent or taken, self._effort, strict=True):
            # What was sent last may have been lost, or be on its way yet: near to both, if they aren't too far apart.
            near = s if abs(s - t) < 2 * STEP else t
            sent.append(min(max(w if isfinite(w) else t, max(t, near) - STEP, -E), min(t, near) + STEP, E))
        self._sent = sent
        return sent


class MotionLimiter:
    """Bounds a joint motion by velocity, acceleration and jerk, and keeps the way that braking takes.

    Attributes:
        q, dq, ddq: what was sent last: rad, rad/s, rad/s^2 (7,).
    """

    def __init__(self, limits: RobotLimits) -> None:
        self._limits = limits
        self._acceleration = [ACCELERATION * a for a in limits.acceleration]
        self._jerk_step = [JERK * j * DT for j in limits.jerk]
        self.q, self.dq, self.ddq = [0.0] * 7, [0.0] * 7, [0.0] * 7
        self._last: list[float] | None = None
        self._lasts = DT  # s that a packet is expected to last

    def start(self, q: Sequence[float]) -> None:
        """A motion begins at rest at the robot's q_d (rad)."""
        self.q, self.dq, self.ddq = list(q), [0.0] * 7, [0.0] * 7
        self._last = None
        self._lasts = DT

    def take(self, q: Sequence[float], dq: Sequence[float], ddq: Sequence[float], ticks: int = 1) -> None:
        """The robot's account (q_d, dq_d, ddq_d) of the last packet; where it agrees, what was sent is more exact.

        `ticks`: ms of the robot's time since the last packet.
        """
        self._lasts = max(min(ticks, 20) * DT, DT + _FORGET * (self._lasts - DT))
        self.q = _agreed(q, self.q)
        self.dq = _agreed(dq, self.dq)
        self.ddq = _agreed(ddq, self.ddq)

    def velocity(self, wanted: Sequence[float]) -> list[float]:
        """The velocities to send, rad/s (7,): as near to `wanted` as the limits allow."""
        late = 2 * (self._lasts - DT)
        for i, v in enumerate(self.dq):
            least, most = self._limits.bounds(i, self.q[i], v, late)
            target = min(max(wanted[i] if isfinite(wanted[i]) else 0.0, least), most)
            step, A, a = self._jerk_step[i], self._acceleration[i], self.ddq[i]
            ahead = approach(target - v, step, self._lasts)
            ahead = min(max(ahead, a - step, -A), a + step, A)
            self.dq[i], self.ddq[i] = v + ahead * DT, ahead
            self.q[i] += self.dq[i] * DT
        return self.dq

    def position(self, wanted: Sequence[float]) -> list[float]:
        """The positions to send, rad (7,): follow `wanted`, which moves within the limits, without a lasting lag."""
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
        """Nothing moves any more, as far as commanded."""
        return max(map(abs, self.dq)) < 1e-4 and max(map(abs, self.ddq)) < 1e-1


def approach(error: float, step: float, dt: float = DT) -> float:
    """The acceleration for the next packet with which a velocity gets to its target fastest and doesn't overshoot.

    With n packets left the accelerations are x, x - step, ..., x - (n - 1) step and add up to error / dt.

    Args:
        error: target velocity less the present one.
        step: the change of acceleration from packet to packet.
        dt: s that a packet lasts.
    """
    s = abs(error) / (step * dt)
    if s <= 1:
        return error / dt
    n = ceil((sqrt(1 + 8 * s) - 1) / 2)
    x = step * (s + n * (n - 1) / 2) / n
    return x if error > 0 else -x


def catch_up(error: float, brake: float, follow: float = FOLLOW) -> float:
    """The velocity that makes up for a position's error: proportional while it is small, then one that `brake` stops.

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
