"""The guard of velocity commands."""

from __future__ import annotations

from math import sqrt

from runtime.contracts.errors import WiringError
from runtime.contracts.signals import Stop
from runtime.guard.base import RETRACT_SPEED, CommandGuard, finite

# Periods of motion reserved before a position limit. Near the limit the speed is distance / REACTION periods. With
# four or more, a device that obeys one period late does not overshoot.
REACTION = 4


class VelocityGuard(CommandGuard):
    """Limits a velocity, its change by the acceleration limit, and the velocity by the distance left to stop.

    The acceleration is computed from the last applied command. The distance left is computed from the measured
    position: only the measurement tells where a device that integrates the velocity really is.
    """

    needs = ("velocity", "acceleration")

    def _bound(self) -> None:
        if self._position is None and (self.held_in or self.rest is not None):
            raise WiringError(
                self.place,
                "position limits or a rest position on a velocity command need the measured position",
                "Use a device that measures it, or take lower, upper and rest out of the profile",
            )
        self.velocity = self.applied

    def _restart(self, position: list[float], velocity: list[float]) -> None:
        self._apply([0.0] * self.size)

    def _seat(self, sent: list[float], which: list[int]) -> None:
        for i in which:
            self.applied.flat[i] = sent[i]

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        self._apply(self._bounded(desired, self.max_velocity, dt))

    def _halt(self, category: Stop, dt: float) -> None:
        if category is Stop.RETRACT and self.rest is not None and self._sensed():
            assert self._position is not None
            left = [r - q for r, q in zip(self.rest, self._position.ravel().tolist(), strict=True)]
            limits = [RETRACT_SPEED * V for V in self.max_velocity]
            wanted = [self._arrival(i, d) if d >= 0 else -self._arrival(i, -d) for i, d in enumerate(left)]
            applied = self._bounded(wanted, limits, dt)
            self.at_rest = all(abs(d) <= self.tolerance for d in left)
        else:
            applied = []
            for v, A in zip(self.applied.ravel().tolist(), self.max_acceleration, strict=True):
                applied.append(min(max(0.0, v - A * dt), v + A * dt))
            self.at_rest = not any(applied)
        self._apply(applied)

    def _sensed(self) -> bool:
        return self._position is None or (not self.blind and finite(self._position.ravel().tolist()))

    def _bounded(self, desired: list[float], limits: list[float], dt: float) -> list[float]:
        """The velocity nearest to `desired` within the speed limit, the distance left and the acceleration limit.

        The acceleration limit is applied last, so it always holds.
        """
        # Plain comparisons: min and max cost four times as much.
        position = [0.0] * self.size if self._position is None else self._position.ravel().tolist()
        out = []
        joints = zip(desired, self.applied.ravel().tolist(), position, limits, self.max_acceleration, strict=True)
        for i, (wanted, v, q, V, A) in enumerate(joints):
            u = -V if wanted < -V else V if wanted > V else wanted
            if self.held_in:
                way = self._arrival(i, self.upper[i] - q) if u > 0.0 else self._arrival(i, q - self.lower[i])
                u = way if u > way else -way if u < -way else u
            least, most = v - A * dt, v + A * dt
            out.append(least if u < least else most if u > most else u)
        return out

    def _arrival(self, i: int, distance: float) -> float:
        """The speed v from which a stop after the reaction time T takes `distance`: v T + v^2/2A = distance."""
        if distance <= 0:
            return 0.0
        A = self.max_acceleration[i]
        ramp = A * REACTION * self.dt
        return sqrt(ramp * ramp + 2 * A * distance) - ramp

    def _apply(self, values: list[float]) -> None:
        self.applied.reshape(-1)[:] = values
