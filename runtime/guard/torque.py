"""The guard of torque commands."""

from __future__ import annotations

from math import inf

import numpy as np

from runtime.errors import WiringError
from runtime.guard.base import CommandGuard, finite
from runtime.signals import Array, Command, Limits, Stop

ZONE = 0.05  # of a joint's range: where the barrier's spring reaches the effort limit
FADE = 0.25  # of the velocity limit: range below it in which effort that would exceed it fades out
HOLD_TIME = 0.2  # s: damping over stiffness of the hold
STILL = 0.02  # of the velocity limit: slower than this a joint is at rest


class TorqueGuard(CommandGuard):
    """Bounds a torque by effort, its change by the effort rate, and keeps joints off their limits.

    All torques are counted from gravity compensation g, if that is bound, so that the guard neither fights
    nor drops it. With effort limit E and velocity limit V, the damping is d = E/V: full effort at full speed.
    The barrier is a one-sided spring and damper, stiffness k = E/(ZONE range), damping 2d; for qd > 0
    tau - g <= k (upper - q - qd^2/2A) - 2d qd, likewise at the lower limit, each side within [-E, E]: beyond
    a limit what is left points inwards. It takes nothing from a torque that isn't pushing outwards. A is the
    acceleration limit, if given: what the effort surely brakes the joint with. Without it a joint that is
    heavy for its effort overruns the barrier. The velocity limit bounds alike:
    tau - g <= E (V - qd)/(FADE V).

    Stops: `damp` -d qd; `limp` nothing but g; `hold` damps, then springs to where each joint came to rest,
    stiffness d/HOLD_TIME; `brake` and `retract` are `hold`. All within effort and rate.
    """

    needs = ("velocity", "effort", "effort_rate")

    def __init__(
        self,
        place: str,
        command: Command,
        limits: Limits,
        dt: float,
        *,
        rest: Array | None = None,
        tolerance: float = 1e-3,
    ) -> None:
        super().__init__(place, command, limits, dt, rest=rest, tolerance=tolerance)
        if (limits.lower is None) != (limits.upper is None):
            missing = "lower" if limits.lower is None else "upper"
            raise WiringError(
                place,
                f"the joint-limit barrier needs both position limits, and {missing} is missing",
                f"Add {missing} to {place} in the profile",
            )
        self._gravity: Array | None = None
        self._g = [0.0] * self.size  # the newest that was finite
        self._held: list[float | None] = [None] * self.size

    def bind(
        self,
        applied: Array,
        position: Array | None = None,
        velocity: Array | None = None,
        gravity: Array | None = None,
    ) -> None:
        """As the base's; `gravity` is the gravity compensation within the desired torque, None for a device
        that adds its own."""
        super().bind(applied, position, velocity)
        if position is None or velocity is None:
            raise WiringError(
                self.place,
                "a torque command needs the measured position and velocity",
                "Use a device that measures both",
            )
        self._gravity = gravity

    def reset(self, position: Array, velocity: Array | None = None) -> None:
        self._start(position, velocity)
        self._held = [None] * self.size
        self._g = [0.0] * self.size
        self._read_gravity()
        start = [min(max(g, -E), E) for g, E in zip(self._g, self.max_effort, strict=True)]
        self.applied.reshape(-1)[:] = start

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        self._held = [None] * self.size
        self._read_gravity()
        self._apply(desired, dt)

    def _halt(self, category: Stop, dt: float) -> None:
        self._read_gravity()
        q, qd = self._measured()
        blind = not self._sensed()
        out = []
        for i, (g, E, V) in enumerate(zip(self._g, self.max_effort, self.max_velocity, strict=True)):
            if blind or category is Stop.LIMP:
                out.append(g)
                continue
            tau = -E / V * qd[i]
            if category is not Stop.DAMP:
                held = self._held[i]
                if held is None and abs(qd[i]) <= STILL * V:
                    held = self._held[i] = q[i]
                if held is not None:
                    tau += E / V / HOLD_TIME * (held - q[i])
            out.append(g + tau)
        self._apply(out, dt, sighted=not blind)
        if blind or category is Stop.LIMP:
            applied = self.applied.ravel().tolist()
            self.at_rest = all(abs(x - t) <= self.tolerance for x, t in zip(applied, out, strict=True))
        else:
            self.at_rest = all(abs(w) <= STILL * V for w, V in zip(qd, self.max_velocity, strict=True))

    def _apply(self, wanted: list[float], dt: float, sighted: bool = True) -> None:
        q, qd = self._measured()
        out = []
        for i, (tau, last) in enumerate(zip(wanted, self.applied.ravel().tolist(), strict=True)):
            E, g, bounded = self.max_effort[i], self._g[i], tau
            if sighted:
                least, most = self._range(i, q[i], qd[i])
                bounded = min(max(tau - g, least), most) + g
            bounded = min(max(bounded, -E), E)
            step = self.max_effort_rate[i] * dt
            out.append(min(max(bounded, last - step), last + step))
        self.applied.reshape(-1)[:] = out

    def _range(self, i: int, q: float, qd: float) -> tuple[float, float]:
        """What velocity limit and barrier leave of joint i's torque, counted from gravity compensation."""
        E, V, low, high = self.max_effort[i], self.max_velocity[i], self.lower[i], self.upper[i]
        least, most = -E * (V + qd) / (FADE * V), E * (V - qd) / (FADE * V)
        if -inf < low and high < inf:
            k, d = E / (ZONE * (high - low)), E / V
            way = qd * abs(qd) / (2 * self.max_acceleration[i])  # to brake on
            most = min(most, k * (high - q - max(way, 0.0)) - 2 * d * max(qd, 0.0))
            least = max(least, k * (low - q - min(way, 0.0)) - 2 * d * min(qd, 0.0))
        return min(max(least, -E), E), min(max(most, -E), E)

    def _sensed(self) -> bool:
        q, qd = self._measured()
        return finite(q) and finite(qd)

    def _measured(self) -> tuple[list[float], list[float]]:
        assert self._position is not None
        assert self._velocity is not None
        return self._position.ravel().tolist(), self._velocity.ravel().tolist()

    def _read_gravity(self) -> None:
        if self._gravity is not None and np.isfinite(self._gravity).all():
            self._g = self._gravity.ravel().tolist()
