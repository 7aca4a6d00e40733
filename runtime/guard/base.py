"""The base class of the guards. Each guard stands between one command's controller and its driver."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import inf, isfinite
from operator import sub

import numpy as np

from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.errors import DeviceError, WiringError
from srl.runtime.contracts.signals import Array, Command, Kind, Limits, Stop
from srl.runtime.guard.fast import Fast
from srl.runtime.guard.limits import INTENSITY, NAMES
from srl.runtime.guard.sent import SentTracker, rounding
from srl.runtime.guard.verified import VerifiedStop

PROMPT = 2  # periods: a limb commanded by position waits in a longer cycle, and goes on only if that is clear anew
LONGEST = 5  # periods: a longer pause is not made up for, the motion continues from where the device is
SHORTEST = 1e-3  # periods: a clock that stands still must not cause a division by zero
RETRACT_SPEED = 0.25  # of the velocity limit
RATES = ("velocity", "acceleration", "jerk", "effort", "effort_rate", "inertia", *INTENSITY)
SMALLEST, LARGEST = 1e-9, 1e9  # limits that a device gives must lie in between, in any unit


class CommandGuard(ABC):
    """Limits one command. Life cycle: `bind` -> (`reset` -> cycles of `resynchronise` and `step` or `stop`), repeated.

    Limits apply to the guard's own state, the last applied command. The guard works from it while the device keeps its
    command's `period` and `resolution`. Where the two part (a stalled link, a limiter in the device), `resynchronise`
    puts the state back to what was sent, for those elements alone that part.

    After `reset`, a guard makes no lasting allocations, never blocks and never raises. On bad input it brakes.

    Attributes:
        applied: the guarded command for the device, of the command's shape and unit.
        velocity: rate of `applied` (kind position) or `applied` itself (velocity); zero for torque.
        rejected: this cycle's desired command was not finite, or a measurement it needs was not finite or old.
        limited: this cycle's desired command was changed by more than the tolerance.
        fallback: this cycle braked because the trajectory generator failed.
        resynchronised: this cycle began at what was sent instead of the last applied command.
        rejections, limitations, fallbacks, resyncs: number of cycles with the flag since the guard was made.
        held_in: the command has a position limit.
        at_rest: the present stop is complete.
        unmeasured: the measurements are old. The runtime sets it; the guard then makes no decision based on them.
        stamp: ns, when they were taken; the runtime sets it. None: in each cycle anew.
        verified: asks the clearance of `keep_clear`; None without one.
        fast: computes its ordinary cycles in C; None: Python computes all.
    """

    needs: tuple[str, ...] = ()  # limits that it requires
    may_be_zero: tuple[str, ...] = ("velocity", "effort", "effort_rate")

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
        """Takes the fixed settings.

        Args:
            place: place for errors: `guard.<signal>`.
            command: the command to limit.
            limits: the narrower of the profile's and the device's limits, arrays of the command's shape.
            dt: nominal period, s.
            rest: position to which the stop category `retract` goes; without it the guard holds.
            tolerance: change of the command, in its unit, above which it counts as limited.
        Raises:
            WiringError: a required limit is missing, limits leave no room, or an array has another shape.
        """
        self.place, self.command, self.dt, self.tolerance = place, command, dt, tolerance
        self.size = command.size
        missing = [name for name in self.needs if getattr(limits, name) is None]
        if missing:
            needs = ", ".join(missing)
            problem = f"a command of kind {command.kind} needs {needs}; neither profile nor device limits it"
            raise WiringError(place, problem, f"Add {missing[0]} there")
        felt = command.kind is Kind.INTENSITY
        given = [name for name in NAMES if getattr(limits, name) is not None]
        if foreign := [name for name in given if (name in INTENSITY) is not felt]:
            problem = f"a command of kind {command.kind} has no {foreign[0]}"
            raise WiringError(place, problem, f"Take {foreign[0]} out; it is bounded by: {', '.join(self.needs)}")
        self.lower = self._flat("lower", limits.lower, -inf)
        self.upper = self._flat("upper", limits.upper, inf)
        self.max_velocity = self._flat("velocity", limits.velocity, inf)
        self.max_acceleration = self._flat("acceleration", limits.acceleration, inf)
        self.max_jerk = self._flat("jerk", limits.jerk, inf)
        self.max_effort = self._flat("effort", limits.effort, inf)
        self.max_effort_rate = self._flat("effort_rate", limits.effort_rate, inf)
        self.inertia = self._flat("inertia", limits.inertia, inf)
        for name in RATES:
            values = self._flat(name, getattr(limits, name), inf)
            # Zero would be a divisor, and a joint that can't accelerate can't brake. NaN would act as no limit.
            least = 0.0 if name in self.may_be_zero else SMALLEST
            most = LARGEST if name in self.needs else inf
            wrong = [value for value in values if not least <= value <= most]
            if wrong:
                raise WiringError(
                    place,
                    f"the {name} limit {wrong[0]:g} is none a {command.kind} command can be held to",
                    "Correct it in the profile, or check what the device gives as its own",
                )
        for low, high in zip(self.lower, self.upper, strict=True):
            if not low < high:
                raise WiringError(
                    place,
                    f"lower {low:g} and upper {high:g} leave no room",
                    "Widen the profile's limits, or check them against the device's own",
                )
        self.held_in = any(low > -inf for low in self.lower) or any(high < inf for high in self.upper)
        self.rest = None if rest is None else self._flat("rest", rest, 0.0)
        if self.rest is not None and any(
            not low <= r <= high for r, low, high in zip(self.rest, self.lower, self.upper, strict=True)
        ):
            raise WiringError(place, f"the rest position {self.rest} is outside the limits", "Move it inside")

        self.applied: Array = np.zeros(command.shape)
        self.velocity: Array = np.zeros(command.shape)
        self.rejected = self.limited = self.fallback = self.resynchronised = self.at_rest = False
        self.rejections = self.limitations = self.fallbacks = self.resyncs = 0
        # One period of the loop more: a command that is due may leave in this cycle.
        wait = self._wait = max((command.period or 0.0) + dt, LONGEST * dt)
        resolution = np.broadcast_to(np.ravel(command.resolution), self.size).tolist()
        self._tracker = SentTracker(command.kind, wait, resolution)
        self._sent: Array | None = None
        self._gravity: Array | None = None
        self._position: Array | None = None
        self._velocity: Array | None = None
        self._ready = self._was_active = self._stopping = False
        self.unmeasured = False
        self.stamp: int | None = None
        self.verified: VerifiedStop | None = None
        self.fast: Fast | None = None
        self._prepare(limits)

    def _prepare(self, limits: Limits) -> None:
        """Further setup from the limits by one kind of guard. Raises WiringError as `__init__` does."""

    def bind(
        self,
        applied: Array,
        position: Array | None = None,
        velocity: Array | None = None,
        sent: Array | None = None,
        gravity: Array | None = None,
    ) -> None:
        """Takes the arrays, which the runtime allocates once. The arrays that one kind doesn't read may be there.

        Args:
            applied: array that `step` and `stop` fill; C-contiguous.
            position: measured position, read by velocity and torque guards.
            velocity: measured velocity, read by torque guards.
            sent: what was transmitted to the device, read by `resynchronise`; NaN before the first command.
            gravity: the gravity compensation contained in the desired torque, read by torque guards; None for a device
                that adds its own.
        Raises:
            WiringError: an array that this kind needs is missing, or one has another shape.
        """
        arrays = {"applied": applied, "position": position, "velocity": velocity, "sent": sent, "gravity": gravity}
        for name, array in arrays.items():
            if array is not None and array.shape != self.command.shape:
                raise WiringError(
                    self.place,
                    f"{name} has shape {array.shape}, the command {self.command.shape}",
                    "Wire arrays of the command's shape",
                )
        self.applied, self._position, self._velocity = applied, position, velocity
        self.fast = None  # it is bound to the arrays that were
        self._sent, self._gravity = sent, gravity
        self._bound()

    def keep_clear(
        self, clearance: Clearance, lag: float, tracking: Array, timeout: float | None = None,
        least_lag: float = 0.0, period: float | None = None,
    ) -> None:  # fmt: skip
        """From now on applies only what the limb can brake from and keep clear. After `bind`, before `reset`.

        Args:
            clearance: the judge, bound.
            lag, least_lag, tracking: as in `VerifiedStop`.
            timeout: s, after which the device ends a velocity by itself; a velocity guard needs it.
            period: s; a position leaves at least this often. None: as its driver says.
        Raises:
            WiringError: the braking motion of such a command isn't known.
        """
        self.check_stroke(clearance)
        prompt = max((self.command.period or 0.0 if period is None else period) + self.dt, PROMPT * self.dt)
        self._tracker.timeout = prompt + self.dt / 2  # a driver may send a command in its next `read`
        late = prompt - self.dt / 2  # a command leaves up to half a period after its cycle began
        limits = self.max_acceleration, self.max_jerk
        self.verified = VerifiedStop(clearance, lag, prompt, tracking, *limits, least_lag=least_lag, late=late)

    def check_stroke(self, clearance: Clearance, known: bool = True) -> None:
        """Whether the position limits keep the limb where the clearance is right about it.

        Args:
            clearance: the judge.
            known: all limits are known; else those that there are, are looked at.
        Raises:
            WiringError: they don't.
        """
        names = self.command.labels or ("it",) * self.size
        for name, low, high, most in zip(names, self.lower, self.upper, clearance.stroke.ravel().tolist(), strict=True):
            far = max((abs(value) for value in (low, high) if known or isfinite(value)), default=0.0)
            if far > most:
                raise WiringError(
                    self.place,
                    f"{name} may go {far:g} from its zero, and the clearance is right up to {most:g}",
                    f"Give it narrower `lower` and `upper`, or `clear:` a `stroke` of {far:g}" if isfinite(far) else
                    "Give it `lower` and `upper`",
                )  # fmt: skip

    def _bound(self) -> None:
        """Further checks of the arrays by one kind of guard. Raises WiringError as `bind` does."""

    def reset(self, position: Array, velocity: Array | None = None, *, was_active: bool = False) -> None:
        """Restarts the guard without a jump. Afterwards `applied` holds the first command.

        Args:
            position: measured position, or home for a device without feedback.
            velocity: present velocity of the command, zero if None; it is clipped to its limit.
            was_active: the device has followed this guard up to now, in a stop. A torque goes on from what was sent
                last.
        Raises:
            DeviceError: the position or velocity is not finite.
        """
        start = self._start(position, velocity)
        self._was_active, self._stopping = was_active, False
        if self.fast is not None:
            self.fast.forget()
        self._restart(*start)
        self._tracker.restart(self.applied.ravel().tolist())

    def resynchronise(self, transmitted: bool, dt: float) -> None:
        """Begins anew at what was sent where the device hasn't kept its command's period and resolution.

        Called once a cycle before the controllers, which then read the new state back. A position begins at rest. An
        element that was sent as it was applied, now or one cycle ago (a driver may send it in its next `read`), goes
        on unchanged. If nothing was sent since the reset, the guard begins at the first command again.

        Args:
            transmitted: a command was transmitted to the device since the last call.
            dt: actual time since the last cycle, s.
        """
        self.resynchronised = False
        if self._sent is None or not self._ready:
            return
        if self.fast is not None and self.fast.taken(transmitted, dt):
            return
        applied = self.applied.ravel().tolist()
        parted = self._tracker.compare(self._sent.ravel().tolist(), applied, transmitted, dt)
        if parted and self._stopping and self.command.kind is not Kind.POSITION:
            # A stop goes on, whatever leaves: it may begin anew nearer to zero, never further from it.
            restart_at = self._tracker.restart_at
            velocity = self.command.kind in (Kind.VELOCITY, Kind.INTENSITY)
            parted = [i for i in parted if velocity and abs(restart_at[i]) < abs(applied[i])]
        if parted:
            if self.fast is not None:
                self.fast.leave()
            self._restart_from(self._tracker.restart_at, parted)
            # A replay with another backend differs in the last bits: those are adopted without a resynchronisation.
            restart_at, tracker = self._tracker.restart_at, self._tracker
            self.resynchronised = tracker.stalled or any(
                abs(restart_at[i] - applied[i]) > rounding(applied[i]) for i in parted
            )
            self.resyncs += self.resynchronised

    @property
    def misreported(self) -> bool:
        """What the driver reports as sent can't have been sent, for longer than a command may wait for its link."""
        return self._tracker.false > self._wait

    def last_sent(self) -> Array:
        """What was sent last, for a start there; NaN where nothing was."""
        assert self._sent is not None
        sent = self._sent.ravel().tolist()
        if self._ready:
            if self.fast is not None:
                self.fast.tell()
            sent = self._tracker.last(sent, self.applied.ravel().tolist())
        return np.array(sent).reshape(self.command.shape)

    def step(self, desired: Array, desired_velocity: Array | None, dt: float) -> None:
        """Runs one cycle with a command from the controller.

        Args:
            desired: the controller's desired command.
            desired_velocity: its rate, if the controller knows it; only the position guard reads it.
            dt: actual time since the last cycle, s.
        """
        self._begin()
        self._stopping = False
        dt = self._span(dt)
        if self.fast is not None:
            if not self.unmeasured and (done := self.fast.step(desired, desired_velocity, dt)) >= 0:
                self.limited = done > 0
                self.limitations += self.limited
                return
            self.fast.leave()
        wanted = desired.ravel().tolist()
        rate = None if desired_velocity is None else desired_velocity.ravel().tolist()
        if finite(wanted) and (rate is None or finite(rate)) and self._sensed():
            self._follow(wanted, rate, dt)
            changes = map(sub, wanted, self.applied.ravel().tolist())
            self.limited = max(map(abs, changes)) > self.tolerance
            self.limitations += self.limited
        else:
            self.rejected = True
            self.rejections += 1
            self._halt(Stop.HOLD, dt)

    def stop(self, category: Stop, dt: float) -> None:
        """Runs one cycle of a stop. `at_rest` is True once the stop is complete. dt: s since the last cycle."""
        self._begin()
        self._stopping = True
        if self.fast is not None:
            self.fast.leave()
        self._halt(category if self._sensed() else Stop.HOLD, self._span(dt))

    @abstractmethod
    def _restart(self, position: list[float], velocity: list[float]) -> None:
        """Sets the state and `applied` for `reset`."""

    @abstractmethod
    def _restart_from(self, sent: list[float], which: list[int]) -> None:
        """Sets the state and `applied` of these elements to what was sent; a position is at rest there."""

    @abstractmethod
    def _follow(self, desired: list[float], rate: list[float] | None, dt: float) -> None:
        """Sets `applied` as near to the finite `desired` as the limits allow."""

    @abstractmethod
    def _halt(self, category: Stop, dt: float) -> None:
        """Runs one cycle of a stop. Also used when the desired command is unusable."""

    def _sensed(self) -> bool:
        """Whether the measurements that it needs are finite and not old."""
        return True

    def _span(self, dt: float) -> float:
        # After a stall the motion goes on with one period's span, never with the time since.
        stalled, longest, verified = self._tracker.stalled or self.resynchronised, LONGEST * self.dt, self.verified
        if verified is not None:
            verified.elapsed = dt
            verified.waited = verified.late < inf and (stalled or dt > min(verified.late, longest))
            stalled = stalled or verified.waited
        return min(max(dt, SHORTEST * self.dt), self.dt if stalled else longest)

    def _begin(self) -> None:
        if not self._ready:
            raise RuntimeError(f"{self.place}: step or stop before reset")
        self.rejected = self.limited = self.fallback = self.at_rest = False

    def _start(self, position: Array, velocity: Array | None) -> tuple[list[float], list[float]]:
        p = np.broadcast_to(np.asarray(position, np.float64), self.command.shape).ravel().tolist()
        v = [0.0] * self.size if velocity is None else np.asarray(velocity, np.float64).ravel().tolist()
        if not (finite(p) and finite(v)):
            problem = "the position to start from is not finite"
            raise DeviceError(self.place, problem, "Check the device's feedback, then reset")
        self.rejected = self.limited = self.fallback = self.resynchronised = self.at_rest = False
        self._ready = True
        return p, [min(max(x, -limit), limit) for x, limit in zip(v, self.max_velocity, strict=True)]

    def _flat(self, name: str, array: Array | None, default: float) -> list[float]:
        if array is None:
            return [default] * self.size
        if array.shape != self.command.shape:
            problem = f"{name} has shape {array.shape}, the command {self.command.shape}"
            raise WiringError(self.place, problem, "Give one value for each joint")
        values: list[float] = array.ravel().tolist()
        return values


def finite(values: Sequence[float]) -> bool:
    """Whether all values are finite. If one is not, their sum is not finite."""
    return isfinite(sum(values))
