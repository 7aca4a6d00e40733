"""The guard of position commands."""

from __future__ import annotations

from math import copysign, inf, isfinite, isinf, sqrt

from srl.runtime.contracts.signals import Limits, Stop
from srl.runtime.guard.approach import approach
from srl.runtime.guard.base import RETRACT_SPEED, CommandGuard, finite
from srl.runtime.guard.braking import Bounds, State, brake, stop_range, stoppable
from srl.runtime.guard.verified import VerifiedStop, stop_time

SLACK = 1e-10  # rad or m: tolerance for rounding when two braking distances are compared
SQRT2 = sqrt(2.0)
CATCH_UP_V, CATCH_UP_A = 0.01, 0.1  # shares of the limits that are reserved to catch up with a moving target


class PositionGuard(CommandGuard):
    """Follows a desired position within limits of position, velocity, acceleration and jerk.

    The state is the last applied command (p, v, a) of each joint, never the measurement: a limiter that
    compares with a lagging measured position slows the motion. Joints are independent. In each cycle, for
    each joint:

    1. If the jerk is unbounded and the desired position can be reached in this cycle, it is applied as it is.
    2. Otherwise the fastest motion to meet the moving target is planned, by ruckig if the jerk is bounded. The plan
       first uses the target's velocity and acceleration. If this motion would leave the limits, the next plan omits
       the acceleration, and the last one assumes that the target stands still.
    3. A plan's next state is used only if the joint can still stop from there within its limits. If no plan
       allows this, the joint brakes.

    The target's velocity is the controller's, or else the difference of two desired positions. If two
    successive velocities differ by more than the acceleration limit allows, this is a jump and not a motion.
    Then the estimate changes at that limit, and the acceleration counts as zero.

    With a clearance, the states are a proposal for all joints, which is applied, in part or whole, if the limb can
    brake from it along its path and keep clear (`srl.runtime.guard.verified`). Every stop is along the path then.
    """

    needs = ("velocity", "acceleration")

    def _prepare(self, limits: Limits) -> None:
        bounds = zip(self.max_velocity, self.max_acceleration, self.max_jerk, strict=True)
        self._bounds = [Bounds(V, A, J) for V, A, J in bounds]
        self._slow = [Bounds(RETRACT_SPEED * V, A, J) for V, A, J in self._bounds]
        self._states: list[State] = []
        self._targets: list[float] = []  # the last desired positions
        self._raw: list[float] = []  # their last rates, unfiltered
        self._rates: list[float] = []  # their last rates, as estimated
        # The range in which a stop may end: the limits, or wider if the start was outside. It only shrinks.
        self._floor: list[float] = []
        self._ceiling: list[float] = []
        self._beyond = True
        if not all(map(isinf, self.max_jerk)):
            from srl.runtime.guard.jerk_limited import JerkLimited

            self._jerk_limited = JerkLimited(self.max_jerk)

    def _restart(self, position: list[float], velocity: list[float]) -> None:
        self._states = [(p, v, 0.0) for p, v in zip(position, velocity, strict=True)]
        self._floor, self._ceiling = [-inf] * self.size, [inf] * self.size
        self._beyond = True
        if self.verified is not None:
            self.verified.restart(position)
        self._settle()

    def _restart_from(self, sent: list[float], which: list[int]) -> None:
        for i in which:
            self._states[i] = sent[i], 0.0, 0.0
            self._targets[i], self._raw[i], self._rates[i] = sent[i], 0.0, 0.0
            self._floor[i], self._ceiling[i] = -inf, inf
        self._beyond = True
        self._publish()

    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        after = []
        for i, wanted in enumerate(desired):
            low, high, bounds = self.lower[i], self.upper[i], self._bounds[i]
            target = low if wanted < low else high if wanted > high else wanted
            given = None if rate is None else rate[i] if target == wanted else 0.0
            speed, acceleration = self._motion(i, target, given, dt)
            after.append(self._towards(i, (target, speed, acceleration), bounds, dt))
        self._go(after, dt)
        self.fallbacks += self.fallback
        self._publish()

    def _halt(self, category: Stop, dt: float) -> None:
        if category is Stop.RETRACT and self.rest is not None:
            ways = enumerate(zip(self.rest, self._slow, strict=True))
            self._go([self._towards(i, (target, 0.0, 0.0), slow, dt) for i, (target, slow) in ways], dt)
            self.at_rest = all(
                s[1] == 0 and abs(s[0] - r) <= SLACK for s, r in zip(self._states, self.rest, strict=True)
            )
        else:
            if self.verified is not None:
                self._compare(self.verified, dt)
                self._states = self.verified.braked(self._states, dt)
            else:
                for i, state in enumerate(self._states):
                    self._states[i] = brake(state, self.max_acceleration[i], self.max_jerk[i], dt)
            self.at_rest = all(s[1] == 0 and s[2] == 0 for s in self._states)
        self.fallbacks += self.fallback
        self._settle()

    def _go(self, after: list[State], dt: float) -> None:
        """Takes these states as the next ones; with a clearance, as far as it lets the limb."""
        if self.verified is None:
            self._states = after
            return
        self._compare(self.verified, dt)
        self._states = self.verified.choose(self._states, after, dt, self._stops_within)

    def _compare(self, verified: VerifiedStop, dt: float) -> None:
        """Once a cycle, in a stop too: what is beside its command then is so in the next one."""
        measured: list[float] | None = None if self._position is None else self._position.ravel().tolist()
        verified.compare([p for p, _, _ in self._states], measured, max(dt, verified.elapsed))
        if measured is not None and (self.unmeasured or not finite(measured)):
            verified.unmeasured()

    def _stops_within(self, states: list[State]) -> bool:
        """Whether all joints keep their position limits if they brake together."""
        if not isinf(min(self.max_jerk)):
            return all(self._safe(i, state) for i, state in enumerate(states))
        T = stop_time([v for _, v, _ in states], self.max_acceleration)
        ends = zip(states, self._floor, self._ceiling, strict=True)
        return all(low - SLACK <= min(p, p + v * T / 2) and max(p, p + v * T / 2) <= high + SLACK
                   for (p, v, _), low, high in ends)  # fmt: skip

    def _motion(self, i: int, target: float, given: float | None, dt: float) -> tuple[float, float]:
        """Velocity and acceleration of joint i's target at the end of this cycle."""
        step = self.max_acceleration[i] * dt
        raw = (target - self._targets[i]) / dt if given is None else given
        change = raw - self._raw[i]
        self._targets[i], self._raw[i] = target, raw
        if abs(change) <= step:
            self._rates[i] = raw
            # The difference of two positions is the velocity half a cycle ago.
            return (raw + change / 2 if given is None else raw), change / dt
        last = self._rates[i]
        self._rates[i] = min(max(raw, last - step), last + step)
        return (self._rates[i] if given is None else raw), 0.0

    def _towards(self, i: int, target: State, bounds: Bounds, dt: float) -> State:
        """Joint i's state after dt on its way to meet `target`, which is the desired state at that time."""
        state, (V, A, J), (wanted, speed, acceleration) = self._states[i], bounds, target
        # The target itself must be able to stop within the limits.
        if speed:
            room = self.upper[i] - wanted if speed > 0 else wanted - self.lower[i]
            most = min(stoppable(room, A, J), V)
            if abs(speed) > most:
                speed, acceleration = copysign(most, speed), 0.0
        if isinf(J):
            exact = reach(state, wanted, speed, bounds, dt)
            if exact is not None and self._safe(i, exact):
                return exact
        elif state == (wanted, 0.0, 0.0) and speed == 0:
            return state
        tried = None
        for moving in ((wanted, speed, acceleration), (wanted, speed, 0.0), (wanted, 0.0, 0.0)):
            if moving != tried:
                planned = self._planned(i, moving, bounds, dt)
                if planned is not None and self._safe(i, planned):
                    return planned
                tried = moving
        self.fallback = True
        return brake(state, A, J, dt)

    def _planned(self, i: int, target: State, bounds: Bounds, dt: float) -> State | None:
        """The state after dt on the fastest motion, planned in coordinates in which the target rests at zero.

        The acceleration left for catching up is A minus the target's own, in either direction. A plan with more
        would turn too late when the target brakes, and never catch up with it.
        """
        (p, v, a), (wanted, speed, acceleration), (V, A, J) = self._states[i], target, bounds
        room, spare = (1 - CATCH_UP_V) * V, (1 - CATCH_UP_A) * A
        speed = within(speed, room)
        acceleration = within(acceleration, spare)
        earlier = within(speed - acceleration * dt, room)
        x, xd = p - (wanted - speed * dt + acceleration * dt * dt / 2), v - (speed - acceleration * dt)
        slowest, fastest = (-V - speed, V - earlier) if speed < earlier else (-V - earlier, V - speed)
        left = A - abs(acceleration)
        if isinf(J):
            x, xd = approach(x, xd, slowest, fastest, left, dt)
            xdd = 0.0
        else:
            planned = self._jerk_limited.after(i, x, xd, a - acceleration, slowest, fastest, left, dt)
            if planned is None:
                return None
            x, xd, xdd = planned
        way, after = wanted + x - p, speed + xd
        # A braking target is faster in mid-cycle than at the end of the cycle.
        if not isfinite(xd + xdd) or not abs(way) <= V * dt * (1 + 1e-9):
            return None
        # A target that is very far away takes the last digits of the way there, and so of the command.
        if isinf(J) and not abs(way - dt * (v + after) / 2) <= A * dt * dt / 4 * (1 + 1e-6) + SLACK:
            return None
        return wanted + x, after, 0.0 if isinf(J) else acceleration + xdd

    def _safe(self, i: int, state: State) -> bool:
        """Whether the joint can still stop from `state` without leaving a limit."""
        low, high, fastest = stop_range(state, self.max_acceleration[i], self.max_jerk[i])
        return (
            low >= self._floor[i] - SLACK
            and high <= self._ceiling[i] + SLACK
            and fastest <= self.max_velocity[i] * (1 + 1e-9)
        )

    def _settle(self) -> None:
        """Ends a cycle without a desired command: the next desired command is compared with the applied state."""
        self._targets = [p for p, _, _ in self._states]
        self._raw = [v for _, v, _ in self._states]
        self._rates = list(self._raw)
        self._publish()

    def _publish(self) -> None:
        self.applied.reshape(-1)[:] = [p for p, _, _ in self._states]
        self.velocity.reshape(-1)[:] = [v for _, v, _ in self._states]
        if self.verified is not None:
            self.verified.occupy(self._states)
        if not self._beyond:
            return
        for i, state in enumerate(self._states):
            low, high, _ = stop_range(state, self.max_acceleration[i], self.max_jerk[i])
            self._floor[i] = min(self.lower[i], max(self._floor[i], low))
            self._ceiling[i] = max(self.upper[i], min(self._ceiling[i], high))
        self._beyond = self._floor != self.lower or self._ceiling != self.upper


def within(value: float, most: float) -> float:
    """The nearest value in [-most, most]."""
    return value if -most <= value <= most else copysign(most, value)


def reach(state: State, target: float, speed: float, bounds: Bounds, dt: float) -> State | None:
    """The state at `target` after exactly dt with |acceleration| <= A; None if this is not possible.

    Two pieces of bounded acceleration lead from (p, v) to (target, u) in dt if and only if
    |target - p - dt (v + u)/2| <= A dt^2/4 (1 - ((u - v)/(A dt))^2). Solved for u, this gives an interval. The
    velocity u in it that is nearest to `speed` is used, if it is near enough to meet the target in the next
    cycle too, at the target's own velocity: |u - speed| <= (sqrt 2 - 1) A dt. Otherwise the joint would overshoot.
    """
    (p, v, _), (V, A, _) = state, bounds
    step = A * dt
    w = (target - p - v * dt) / (step * dt)
    if abs(w) > 0.5 or abs(target - p) > V * dt:
        return None
    least = max(v + step * (1 - sqrt(2 - 4 * w)), -V)
    most = min(v + step * (sqrt(2 + 4 * w) - 1), V)
    u = min(max(speed, least), most)
    return (target, u, 0.0) if least <= most and abs(u - speed) <= (SQRT2 - 1) * step else None
