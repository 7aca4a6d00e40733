"""The state machine: how faults and requests change the run's state. The same inputs give the same states.

READY -> HOMING -> ACTIVE -> STOPPING -> STOPPED -> (reset) -> HOMING or ACTIVE

What stops the limb sets a latch. A latch keeps the stop until a reset whose origin may release it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import Cause, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, RequestKind
from srl.runtime.profile.profile import EmergencyInput, Faults

# The reaction to a fault: one category for every actuator, or "stop" for each actuator's own.
_OWN = "stop"


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that stops the limb."""

    cause: Cause
    fault_source: int = -1  # index of the device, controller or emergency input; -1: none


class Machine:
    """The state machine of one run.

    Attributes:
        state: the present state.
        cause, fault_source: why the limb stopped last; the cause is NONE in normal operation.
        latches: what keeps the stop; none of them stands while the limb may move.
        override: the stop category of every actuator; None: each actuator's own.
        exiting: True if the run ends once the limb is at rest.
        automatic: leave READY without a request.
        recover: True in the cycle in which a start or reset was refused because a fault is present. The devices
            are then told to recover. The user sends the request again once the devices have recovered.
    """

    def __init__(
        self,
        faults: Faults,
        emergency: Sequence[EmergencyInput],
        automatic: bool,
        latched: Latch = latches.NONE,
        granted: Latch = latches.GRANTED,
    ) -> None:
        """Begins in READY, or in STOPPED if a latch stands.

        Args:
            faults: the reactions to faults.
            emergency: the emergency inputs.
            automatic: leave READY without a request. Otherwise a person must give the first start: START is latched.
            latched: latches of an earlier run.
            granted: latches that clients of the bus may release.
        """
        self.state = State.STOPPED if latched else State.READY
        self.cause = Cause.RESTART if latched else Cause.NONE
        self.latches = latched if automatic else latched | Latch.START
        self.fault_source = -1
        self.override: Stop | None = None
        self.exiting = False
        self.recover = False
        self.automatic = automatic
        self._granted = granted
        self._well = False  # every device that concerns the stop has been well since the start
        self._emergency = emergency
        self._reactions = {
            Cause.INTENT_LOSS: faults.intent_loss,
            Cause.DEVICE_LOSS: faults.device_loss,
            Cause.DEVICE_FAULT: faults.device_fault,
            Cause.DRIVER_ERROR: faults.driver_error,
            Cause.CONTROLLER_ERROR: faults.controller_error,
            Cause.CONTACT: faults.contact,
            Cause.FOLLOWING_ERROR: faults.following_error,
            Cause.BUS_LOSS: faults.bus_loss,
        }

    def stop(self, fault: Fault) -> None:
        """Enters the stop and latches it. The first cause is kept until the reset; only an emergency replaces it."""
        if self.state is State.ENDED:
            return
        moving = self.state in (State.ACTIVE, State.HOMING)
        latch = latches.of_cause(fault.cause)
        if moving or latch is Latch.EMERGENCY:
            self.latches |= latch
        # Of two emergencies, the one that comes first in the profile counts.
        emergency = fault.cause is Cause.EMERGENCY and (
            self.cause is not Cause.EMERGENCY or fault.fault_source < self.fault_source
        )
        if moving:
            self._enter(State.STOPPING, fault)
        elif emergency or (self.state is State.READY and fault.cause in (Cause.REQUEST, Cause.END)):
            self._enter(State.STOPPED if self.state is State.READY else self.state, fault)

    def _enter(self, state: State, fault: Fault) -> None:
        self.state, self.cause, self.fault_source = state, fault.cause, fault.fault_source
        if fault.cause is Cause.EMERGENCY and fault.fault_source >= 0:
            reaction: object = self._emergency[fault.fault_source].category
        else:
            reaction = self._reactions.get(fault.cause, _OWN)
        self.override = reaction if isinstance(reaction, Stop) else None

    def watch(self, trouble: bool) -> None:
        """Sets FAULT if a device is lost or refuses to move during a stop: a hand may have cut its power.

        `trouble`: an actuator or an emergency input is lost, stale or at fault in this cycle. Before all of them
        were well for the first time, they are still starting.
        """
        if not trouble:
            self._well = True
        elif self._well and self.state in (State.STOPPING, State.STOPPED):
            self.latches |= Latch.FAULT

    def request(self, kind: RequestKind, origin: Origin, target: int, present: Fault | None) -> Answer:
        """Handles a request that concerns the state. `present` is a fault that is present in this cycle."""
        if kind in (RequestKind.STOP, RequestKind.EXIT, RequestKind.FAULT):
            self.exiting |= kind is RequestKind.EXIT
            fault = Fault(Cause(target) if target else Cause.REQUEST)
            if kind is not RequestKind.FAULT or self._reactions.get(fault.cause) != "ignore":
                self.stop(fault)
            if kind is RequestKind.STOP and self.state is not State.ENDED:
                self.latches |= latches.OF_STOP[origin]
            return Answer.DONE
        if self.latches & ~latches.releasable(origin, self._granted):
            return Answer.REFUSED_LATCH  # before anything else: nor may it have a device recover
        wanted = State.READY if kind is RequestKind.START else State.STOPPED
        if self.state is not wanted or self.exiting:
            return Answer.REFUSED_STATE
        if present is not None:
            self.recover = True
            return Answer.REFUSED_FAULT
        self._begin()
        return Answer.DONE

    def start_if_ready(self, present: Fault | None) -> None:
        """Leaves READY without a request, once no fault is present, if the run starts automatically."""
        if self.state is State.READY and self.automatic and present is None and not self.exiting:
            self._begin()

    def _begin(self) -> None:
        self.state, self.cause, self.fault_source, self.override = State.HOMING, Cause.NONE, -1, None
        self.latches = latches.NONE

    def settle(self, at_rest: bool) -> None:
        """Ends homing or a stop once at rest. Called once a cycle, after the guards."""
        if self.state is State.HOMING and at_rest:
            self.state = State.ACTIVE
        elif self.state is State.STOPPING and at_rest:
            self.state = State.STOPPED
        if self.exiting and self.state in (State.STOPPED, State.READY):
            self.state = State.ENDED


class OverrunCounter:
    """Counts overruns: a few are tolerated, more degrade telemetry, many stop the limb."""

    def __init__(self, tolerate: int, window: float, stop: int) -> None:
        self._tolerate, self._window, self._stop = tolerate, round(window * 1e9), stop
        self._times: deque[int] = deque()

    def count(self, now: int, overruns: int) -> tuple[bool, bool]:
        """Takes this cycle's overruns; returns (telemetry degraded, stop)."""
        for _ in range(min(overruns, self._stop)):
            self._times.append(now)
        while self._times and self._times[0] < now - self._window:
            self._times.popleft()
        return len(self._times) > self._tolerate, len(self._times) >= self._stop
