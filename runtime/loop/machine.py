"""The state machine: what faults and requests do to the run. Pure: the same inputs, the same states.

READY -> HOMING -> ACTIVE -> STOPPING -> STOPPED -> (reset) -> HOMING or ACTIVE
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from runtime.contracts.signals import Stop
from runtime.ipc.requests import Answer, RequestKind
from runtime.ipc.words import Cause, State
from runtime.profile.profile import EmergencyInput, Faults

# What a fault leads to: a category for every actuator, or "stop", each actuator's own.
_OWN = "stop"


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that stops the limb."""

    cause: Cause
    culprit: int = -1  # index of the device, controller or emergency input; -1: none


class Machine:
    """See the module's text.

    Attributes:
        state: now.
        cause, culprit: why it stopped last; NONE while all is well.
        override: the category that stops every actuator; None: each its own.
        exiting: the run ends once it is at rest.
        recover: a person asked for motion while a fault stands, and was refused: the devices are told to recover.
            They ask again once the devices are well. True for the cycle of the request.
    """

    def __init__(
        self, faults: Faults, emergency: Sequence[EmergencyInput], automatic: bool, stopped_by: Cause = Cause.NONE
    ) -> None:
        """`automatic`: READY goes on by itself; `stopped_by`: begins in the stop (after a crash)."""
        self.state = State.STOPPED if stopped_by else State.READY
        self.cause = stopped_by
        self.culprit = -1
        self.override: Stop | None = None
        self.exiting = False
        self.recover = False
        self._automatic = automatic
        self._emergency = emergency
        self._reactions = {
            Cause.INTENT_LOSS: faults.intent_loss,
            Cause.DEVICE_LOSS: faults.device_loss,
            Cause.DEVICE_FAULT: faults.device_fault,
            Cause.DRIVER_ERROR: faults.driver_error,
            Cause.CONTROLLER_ERROR: faults.controller_error,
            Cause.BUS_LOSS: faults.bus_loss,
        }

    def stop(self, fault: Fault) -> None:
        """Enters the stop. The first cause stands until the reset; only an emergency overrules it."""
        if self.state is State.ENDED:
            return
        # Of two emergencies the one that the profile lists first counts.
        emergency = fault.cause is Cause.EMERGENCY and (
            self.cause is not Cause.EMERGENCY or fault.culprit < self.culprit
        )
        if self.state in (State.ACTIVE, State.HOMING):
            self._enter(State.STOPPING, fault)
        elif emergency or (self.state is State.READY and fault.cause in (Cause.REQUEST, Cause.END)):
            self._enter(State.STOPPED if self.state is State.READY else self.state, fault)

    def _enter(self, state: State, fault: Fault) -> None:
        self.state, self.cause, self.culprit = state, fault.cause, fault.culprit
        if fault.cause is Cause.EMERGENCY and fault.culprit >= 0:
            reaction: object = self._emergency[fault.culprit].category
        else:
            reaction = self._reactions.get(fault.cause, _OWN)
        self.override = reaction if isinstance(reaction, Stop) else None

    def request(self, kind: RequestKind, target: int, present: Fault | None) -> Answer:
        """A client's request; `present` is a fault that is there in this cycle."""
        if kind in (RequestKind.STOP, RequestKind.EXIT, RequestKind.FAULT):
            self.exiting |= kind is RequestKind.EXIT
            fault = Fault(Cause(target) if target else Cause.REQUEST)
            if kind is not RequestKind.FAULT or self._reactions.get(fault.cause) != "ignore":
                self.stop(fault)
            return Answer.DONE
        wanted = State.READY if kind is RequestKind.START else State.STOPPED
        if self.state is not wanted or self.exiting:
            return Answer.REFUSED_STATE
        if present is not None:
            self.recover = True
            return Answer.REFUSED_FAULT
        self._begin()
        return Answer.DONE

    def start_if_ready(self, present: Fault | None) -> None:
        """Leaves READY by itself, once nothing is amiss, where the profile says so."""
        if self.state is State.READY and self._automatic and present is None and not self.exiting:
            self._begin()

    def _begin(self) -> None:
        self.state, self.cause, self.culprit, self.override = State.HOMING, Cause.NONE, -1, None

    def settle(self, at_rest: bool) -> None:
        """Once a cycle, after the guards: the end of homing and of a stop."""
        if self.state is State.HOMING and at_rest:
            self.state = State.ACTIVE
        elif self.state is State.STOPPING and at_rest:
            self.state = State.STOPPED
        if self.exiting and self.state in (State.STOPPED, State.READY):
            self.state = State.ENDED


class Ladder:
    """Overruns: a few are nothing, more cost telemetry, many stop the limb."""

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
