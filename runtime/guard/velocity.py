"""The guard of velocity commands."""

from __future__ import annotations

from math import inf, sqrt

from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array, Limits, Stop
from srl.runtime.contracts.terms import PLANAR_TWIST
from srl.runtime.guard.base import RETRACT_SPEED, CommandGuard, finite
from srl.runtime.guard.braking import State
from srl.runtime.guard.verified import VerifiedStop, brake_together, stop_time

# Periods of motion reserved before a position limit. Near the limit the speed is distance / REACTION periods. With
# four or more, a device that obeys one period late does not overshoot.
REACTION = 4


class VelocityGuard(CommandGuard):
    """Limits a velocity, its change by the acceleration limit, and the velocity by the distance left to stop.

    The acceleration is computed from the last applied command. The distance left is computed from the measured
    position: only the measurement tells where a device that integrates the velocity really is.
    """

    needs = ("velocity", "acceleration")

    def _prepare(self, limits: Limits) -> None:
        self._no_jerk = [inf] * self.size  # a velocity may have any

    def _bound(self) -> None:
        if self._position is None and (self.held_in or self.rest is not None):
            raise WiringError(
                self.place,
                "position limits or a rest position on a velocity command need the measured position",
                "Use a device that measures it, or take lower, upper and rest out of the profile",
            )
        self.velocity = self.applied

    def keep_clear(
        self, clearance: Clearance, lag: float, tracking: Array, timeout: float | None = None,
        least_lag: float = 0.0, period: float | None = None,
    ) -> None:  # fmt: skip
        if self._position is None or self.command.labels == PLANAR_TWIST:
            raise WiringError(
                self.place,
                "where a velocity takes the limb is known only from positions of the same joints",
                "Use a device that measures them, or remove `clear:`",
            )
        if timeout is None:
            raise WiringError(
                self.place,
                "if the loop stalls, a velocity takes the limb on until its device ends it, and nothing says when",
                "Say the device's own time-out in s: add `timeout:` to `clear:`",
            )
        self.check_stroke(clearance)
        goes_on = max(self._wait, timeout)
        self.verified = VerifiedStop(
            clearance, lag, self._wait, tracking, self.max_acceleration, self._no_jerk, goes_on, least_lag
        )

    def _restart(self, position: list[float], velocity: list[float]) -> None:
        self._apply([0.0] * self.size, self.dt)

    def _restart_from(self, sent: list[float], which: list[int]) -> None:
        for i in which:
            self.applied.flat[i] = sent[i]

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        self._go(self._bounded(desired, self.max_velocity, dt), dt)

    def _halt(self, category: Stop, dt: float) -> None:
        if category is Stop.RETRACT and self.rest is not None and self._sensed():
            assert self._position is not None
            left = [r - q for r, q in zip(self.rest, self._position.ravel().tolist(), strict=True)]
            limits = [RETRACT_SPEED * V for V in self.max_velocity]
            wanted = [self._arrival(i, d) if d >= 0 else -self._arrival(i, -d) for i, d in enumerate(left)]
            self._go(self._bounded(wanted, limits, dt), dt)
            self.at_rest = all(abs(d) <= self.tolerance for d in left)
            return
        applied = []
        if self.verified is not None:
            states = [(0.0, v, 0.0) for v in self.applied.ravel().tolist()]
            applied = [v for _, v, _ in brake_together(states, self.max_acceleration, self._no_jerk, dt)]
        else:
            for v, A in zip(self.applied.ravel().tolist(), self.max_acceleration, strict=True):
                applied.append(min(max(0.0, v - A * dt), v + A * dt))
        self.at_rest = not any(applied)
        self._apply(applied, dt)

    def _go(self, wanted: list[float], dt: float) -> None:
        """Applies these velocities; with a clearance, as far as it lets the limb.

        Measured `age` ago at q and moving at v, the limb is at q + (age + lag) v when it obeys a new velocity at the
        latest; until then its velocity may differ from v by as much as it may change in that time. The path begins at
        q, so a limb that obeys earlier is on it, too. It goes on at the new velocity while the loop is late, until the
        device ends that by itself.
        """
        if self.verified is None:
            self._apply(wanted, dt)
            return
        assert self._position is not None
        verified, measured = self.verified, self._position.ravel().tolist()
        states = self._obeys(verified, measured, dt)
        after = [(q + dt * (v + u) / 2, u, 0.0) for (q, v, _), u in zip(states, wanted, strict=True)]
        self._apply([v for _, v, _ in verified.choose(states, after, dt, self._stops_within, measured)], dt)

    def _obeys(self, verified: VerifiedStop, measured: list[float], dt: float) -> list[State]:
        """Where the limb is when it obeys a new velocity, and its present one. Sets the slack."""
        ahead = verified.age + verified.lag
        verified.widen([A * ahead * (ahead / 2 + dt) for A in self.max_acceleration])
        return [(q + ahead * v, v, 0.0) for q, v in zip(measured, self.applied.ravel().tolist(), strict=True)]

    def _stops_within(self, states: list[State]) -> bool:
        """Whether no joint passes its position limits if all brake together."""
        T = stop_time([v for _, v, _ in states], self.max_acceleration)
        return all(
            v == 0 or (p + v * T / 2 <= self.upper[i] if v > 0 else p + v * T / 2 >= self.lower[i])
            for i, (p, v, _) in enumerate(states)
        )

    def _sensed(self) -> bool:
        return self._position is None or (not self.unmeasured and finite(self._position.ravel().tolist()))

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

    def _apply(self, values: list[float], dt: float) -> None:
        if self.verified is not None and self.verified.clearance.watched:
            self._occupy(self.verified, values, dt)
        self.applied.reshape(-1)[:] = values

    def _occupy(self, verified: VerifiedStop, values: list[float], dt: float) -> None:
        """Tells where the limb may be with these velocities."""
        assert self._position is not None
        if not self._sensed():
            verified.unmeasured()
        measured = self._position.ravel().tolist()
        states = self._obeys(verified, measured, dt)
        after = [
            (q + dt * (v + u) / 2 + verified.goes_on * u, u, 0.0) for (q, v, _), u in zip(states, values, strict=True)
        ]
        verified.occupy(after, [measured, [q for q, _, _ in states]])
