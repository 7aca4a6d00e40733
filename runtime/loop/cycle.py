"""The decisions of one cycle: check -> control -> guard. No I/O, no clock: the loop and the replay both run it.

It reads and writes only the row. A recorded row therefore holds everything that a replay needs.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from operator import attrgetter, is_not

import numpy as np

from srl.runtime.contracts.compiled import Backend
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Kind, Limits, Stop
from srl.runtime.guard import IntensityGuard
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import (
    CYCLE,
    DEVICE,
    FLAG_DEGRADED,
    FLAG_FALLBACK,
    FLAG_HELD,
    FLAG_LATE,
    FLAG_LIMITED,
    FLAG_REJECTED,
    FLAG_RESYNCHRONISED,
    LINK_ACTIVE,
    LINK_STALE,
    Cause,
    Latch,
    Origin,
    State,
)
from srl.runtime.ipc.requests import STATE_REQUESTS, Answer, Request, RequestKind
from srl.runtime.loop.backends import Backends
from srl.runtime.loop.faults import FaultFinder, Feedback
from srl.runtime.loop.guards import make_guards
from srl.runtime.loop.machine import Fault, Machine, OverrunCounter
from srl.runtime.loop.monitors import ClearanceMonitor, CommandDelivery, RejectedCommands, ResetInputs
from srl.runtime.profile.graph import Actuator, Graph

TIMEOUT = 5_000_000_000  # ns that a stop may take before the exit: after that the run ends without rest
_CATEGORIES = {category: i for i, category in enumerate(Stop)}
_NOW, _DT, _STATE, _CAUSE = CYCLE.now, CYCLE.dt, CYCLE.state, CYCLE.cause
_FAULT_SOURCE, _CATEGORY, _FLAGS = CYCLE.fault_source, CYCLE.category, CYCLE.flags
_LATCHES, _REFUSED = CYCLE.latches, CYCLE.refused
_REQUEST = slice(CYCLE.request, CYCLE.request_origin + 1)
_STOPS = (RequestKind.STOP, RequestKind.EXIT, RequestKind.FAULT)
_bound = attrgetter("output", "input", "applied", "param", "transform")  # what a law is given by `bind`
_STARTS = (RequestKind.START, RequestKind.RESET)


class Cycle:
    """Makes the decisions of each cycle; see the module's docstring."""

    def __init__(
        self,
        graph: Graph,
        limits: dict[str, Limits],
        automatic: bool,
        latched: Latch = latches.NONE,
        report: Callable[[str], None] = lambda text: None,
        backend: Backend | None = None,
    ) -> None:
        """Builds the guards.

        Args:
            graph: the wired system.
            limits: by command name: the narrower of the profile's and the device's own.
            automatic: leave READY without a request.
            latched: latches of an earlier run: with one, start in the state STOPPED.
            report: takes the text of an event; called rarely.
            backend: computes laws and guards; None: the profile's choice.
        Raises:
            WiringError: there is no C here, and it is to compute.
        """
        self.graph = graph
        profile = graph.profile
        granted = latches.of_names(profile.reset.bus)
        self.machine = Machine(profile.faults, profile.emergency, automatic, latched, granted)
        self.reset_inputs = ResetInputs(graph)
        overrun = graph.profile.faults.overrun.at(graph.profile.rate)
        self.overruns = OverrunCounter(overrun.tolerate, overrun.window, overrun.stop)
        self.report = report
        self.guards = make_guards(graph, limits)
        self._felt = [guard for guard in self.guards if isinstance(guard, IntensityGuard)]
        self._backends = Backends(graph, self.guards, backend)
        self._ints = graph.row.ints
        self._links, self._stamps = graph.row.devices[:, DEVICE.link], graph.row.devices[:, DEVICE.stamp]
        self._faults = FaultFinder(graph, self._lost, self.machine.watch)
        self._delivery = CommandDelivery(graph, self.guards, report)
        self._rejected = RejectedCommands(graph, self.guards, report)
        self._feedback = Feedback(graph, limits, self.guards, report)
        self._clearances = [ClearanceMonitor(graph, a, report) for a in graph.actuators]
        self._laws = [
            (
                law.controller,
                compiled or law.controller,
                _bound(law.controller),
                law.reads,
                law.measured,
                law.writes,
            )
            for law, compiled in zip(graph.laws, self._backends.laws, strict=True)
        ]
        self._gravity_laws = [
            (law.controller, law.reads, law.measured, law.writes)
            for law in graph.laws
            if type(law.controller).update_gravity is not Controller.update_gravity
        ]
        self._gravity_ok = True  # none of them has failed since the last reset
        self._followed = [graph.followed(law) for law in graph.laws]
        # A device without feedback starts at its `home` position, where the user has placed it: at the first
        # start and after a limp stop. After a loss it is near what was sent last and goes home slowly.
        self._homed = [True for a in graph.actuators]
        self._put_home = [a.command.unseen for a in graph.actuators]
        self._started = [False for a in graph.actuators]  # it has been commanded in this run
        self._unmeasured_stay = profile.reset.unmeasured == "refuse"
        self._kept = latches.of_names(profile.reset.keeps)
        self._ran = False  # all laws, in this cycle
        self._leaving = 0  # ns since the exit was requested
        self._fault: Fault | None = None
        self.fault_onset = False  # a fault began in this cycle: what asks for motion came before it
        self._was = State.STARTING

    def check(self, missed: int, request: Request | None = None, answer: Answer = Answer.NONE) -> Answer:
        """Looks for faults, then applies them and the request to the state.

        Args:
            missed: number of periods by which this cycle is late.
            request: the request that this cycle takes, if there is one. A press of a reset input is one, too: while
                `reset_inputs.pressed` says that one waits, only a stop may come before it.
            answer: the request's answer, if it has one already.
        Returns:
            The request's answer. The row's words hold it, too.
        """
        for index, array in self.graph.reads:
            self.graph.row.floats.take(index, 0, array, "clip")
        ints, machine = self._ints, self.machine
        now = int(ints[_NOW])
        before, self._fault = self._fault, self._faults.find(now)
        following = self._feedback.find(ints.item(_DT) * 1e-9)
        self._fault = self._fault or following
        self.fault_onset = self._fault is not None and self._fault != before
        machine.recover = False
        degraded, too_many = self.overruns.count(now, missed)
        ints[_FLAGS] = FLAG_LATE * (missed > 0) + FLAG_DEGRADED * degraded
        overrun = Fault(Cause.OVERRUN) if too_many else None
        if (fault := self._fault or overrun) is not None:
            machine.stop(fault)
        pressed = self.reset_inputs.take()
        if request is None and pressed >= 0:
            request = Request(0, RequestKind.RESET, pressed, 0, np.empty(0), Origin.INPUT)
            if not self.reset_inputs.limit.take(now):
                answer = Answer.REFUSED_RATE
        stop = False
        if request is None:
            ints[_REQUEST] = 0
        else:
            stop = request.kind in _STOPS
            if answer is Answer.NONE and request.kind in STATE_REQUESTS:
                answer = self._refused(request.kind)
            if answer is Answer.NONE and request.kind in STATE_REQUESTS:
                # A client that no longer sends must not prevent a restart of the limb without it. Overruns do, as long
                # as they count: they would stop it again in the next cycle.
                present = None if self._faults.of_client(self._fault) else self._fault
                present, unfit = present or overrun, None
                if request.kind in _STARTS and machine.state in (State.READY, State.STOPPED) and present is None:
                    present = unfit = self._feedback.unfit()
                answer = machine.request(request.kind, request.origin, request.target, present)
                if unfit is not None and answer is Answer.REFUSED_FAULT:
                    # The refusal is reported, and the device is no longer commanded: a later start begins at the
                    # measured position.
                    self._links[unfit.fault_source] &= ~LINK_ACTIVE
            ints[_REQUEST] = request.id, request.kind, request.target, answer, request.origin
            ints[_REFUSED] += answer is not Answer.DONE
        if machine.state is State.READY and machine.automatic:
            machine.start_if_ready(fault or self._feedback.unfit())
        stopped = machine.state in (State.STOPPING, State.STOPPED)
        self.reset_inputs.look(now, stopped and not stop and not self.fault_onset)
        return answer

    def _refused(self, kind: RequestKind) -> Answer:
        """What the profile's `reset:` refuses whoever asks, and from wherever."""
        machine = self.machine
        if kind not in (RequestKind.START, RequestKind.RESET):
            return Answer.NONE
        if machine.latches & self._kept:
            return Answer.REFUSED_KEPT
        if kind is RequestKind.RESET and machine.state is State.STOPPED and self._unmeasured_stay:
            for i, actuator in enumerate(self.graph.actuators):
                # The first motion of a run begins at home, where a person has put the limb.
                if (
                    actuator.command.unseen
                    and self._started[i]
                    and (not self._links.item(actuator.device) & LINK_ACTIVE or self.category(actuator) is Stop.LIMP)
                ):
                    return Answer.REFUSED_UNMEASURED
        return Answer.NONE

    def _lost(self, device: int) -> None:
        """Deactivates a lost or faulty device: even after its return or recovery, no command before the next start."""
        self._links[device] &= ~LINK_ACTIVE
        for i, actuator in enumerate(self.graph.actuators):
            if actuator.device == device and actuator.command.unseen:
                self._homed[i] = False

    def control(self) -> None:
        """Lets the guards see what was sent, then runs the controllers while the limb is active.

        In a stop only those that hold its weight go on, with that alone.
        """
        self._delivery.update(self._ints.item(_DT) * 1e-9)
        if (device := self._delivery.stalled()) >= 0 and self.machine.state is State.ACTIVE:
            self.report(f"'{self.graph.devices[device].name}' has taken no commands as they are for too long")
            self.machine.stop(Fault(Cause.DEVICE_FAULT, device))
        state, self._ran = self.machine.state, False
        if state in (State.STOPPING, State.STOPPED):
            self._update_gravity()
        if state is not State.ACTIVE:
            return
        self._gravity_ok = True
        dt, floats = self._ints.item(_DT) * 1e-9, self.graph.row.floats
        fresh = self._was is not State.ACTIVE
        for i, (controller, law, bound, reads, measured, writes) in enumerate(self._laws):
            try:
                for index, array in reads:
                    floats.take(index, 0, array, "clip")
                for transform in measured:
                    transform.update()
                if fresh:
                    law.reset()
                law.update(dt)
                # By identity: two that are equal aren't the same.
                if any(map(is_not, _bound(controller), bound)):
                    raise TypeError("it has put something else in the place of self.output, or another that is bound")
                for index, array in writes:
                    floats[index] = array
            except Exception:
                self.report(f"controller '{controller.name}' failed: {traceback.format_exc(limit=-3)}")
                self.machine.stop(Fault(Cause.CONTROLLER_ERROR, i))
                self._gravity_ok = False
                return
            if controller.lost:
                why = f": {controller.why}" if controller.why else ""
                self.report(f"controller '{controller.name}' has lost what it follows{why}")
                self.machine.stop(Fault(Cause.INTENT_LOSS, self._followed[i]))
                return
            if controller.contact:
                self.report(f"controller '{controller.name}' found contact")
                self.machine.stop(Fault(Cause.CONTACT, i))
                return
        self._ran = True

    def _update_gravity(self) -> None:
        """Renews the gravity that the guards hold; what fails stays as it was."""
        dt, floats = self._ints.item(_DT) * 1e-9, self.graph.row.floats
        for controller, reads, measured, writes in self._gravity_laws if self._gravity_ok else ():
            try:
                for index, array in reads:
                    floats.take(index, 0, array, "clip")
                for transform in measured:
                    transform.update()
                controller.update_gravity(dt)
                for index, array in writes:
                    floats[index] = array
            except Exception:
                self.report(f"controller '{controller.name}' failed in the stop: {traceback.format_exc(limit=-3)}")
                self._gravity_ok = False

    def guard(self) -> None:
        """Bounds every command or carries out the stop, then updates the state."""
        machine, ints, dt = self.machine, self._ints, self._ints.item(_DT) * 1e-9
        if machine.state is State.HOMING and self._was is not State.HOMING:
            self._begin()
        state = machine.state
        if state is State.STOPPING and self._was is not State.STOPPING:
            for felt in self._felt:
                felt.announce(machine.cause is Cause.INTENT_LOSS)
        at_rest, flags = True, 0
        for i, (actuator, guard) in enumerate(zip(self.graph.actuators, self.guards, strict=True)):
            link = self._links.item(actuator.device)
            if not link & LINK_ACTIVE:
                self._clearances[i].rest()
                if isinstance(guard, IntensityGuard):
                    guard.idle(dt)
                continue
            category = self.category(actuator)
            # With an old measured velocity, damping would drive the joint, and retracting would never arrive.
            guard.unmeasured = bool(link & LINK_STALE)
            guard.stamp = self._stamps.item(actuator.device)
            if guard.verified is not None:
                self._clearances[i].look(guard.verified, self._ran)
            if state is State.ACTIVE:
                guard.step(actuator.asked, actuator.asked_velocity, dt)
            elif state is State.HOMING:
                guard.stop(Stop.HOLD if self._homed[i] else Stop.RETRACT, dt)
                self._homed[i] |= guard.at_rest
                at_rest &= guard.at_rest
            elif by_itself(actuator, category):
                # The loop tells the device to do so; no command follows.
                self._links[actuator.device] &= ~LINK_ACTIVE
                self._put_home[i] = actuator.command.unseen
                self._clearances[i].rest()
            else:
                guard.stop(category, dt)
                at_rest &= guard.at_rest
            ints[_CATEGORY] = _CATEGORIES[category]
            flags |= FLAG_REJECTED * guard.rejected | FLAG_FALLBACK * guard.fallback | FLAG_LIMITED * guard.limited
            flags |= FLAG_RESYNCHRONISED * guard.resynchronised
            if guard.verified is not None:
                flags |= FLAG_HELD * guard.verified.held
                self._clearances[i].update(guard.verified, dt)
        if flags:
            ints[_FLAGS] |= flags
            if flags & FLAG_REJECTED:
                self._rejected.update(dt)
        self._was = state
        if machine.exiting:
            self._leaving += ints.item(_DT)
        machine.settle(at_rest or self._leaving > TIMEOUT)
        ints[_STATE], ints[_CAUSE], ints[_FAULT_SOURCE] = machine.state, machine.cause, machine.fault_source
        ints[_LATCHES] = machine.latches

    def metrics(self) -> dict[str, dict[str, object]]:
        """The laws' own figures, by name, of those that have some. A law that fails here doesn't spoil the run."""
        self._backends.give_back()
        found = {}
        for controller in self.graph.controllers:
            try:
                found[controller.name] = controller.metrics()
            except Exception:
                self.report(f"controller '{controller.name}' has no figures: {traceback.format_exc(limit=-3)}")
        return found

    def category(self, actuator: Actuator) -> Stop:
        """The present stop category of this actuator: the fault's if the actuator supports it, else its own."""
        override = self.machine.override
        return override if override is not None and override in actuator.command.stops else actuator.category

    def _begin(self) -> None:
        """Resets the guards, so that the commands start without a jump, and activates the devices.

        A position command of a device that was led up to now goes on from what was sent last: what one sample says,
        however wrong, moves nothing. Else it starts at the measured position, else at home where the user has placed
        the limb there, else at what was sent last. Velocity and torque guards choose their start themselves.
        """
        was_active = (self._links & LINK_ACTIVE).astype(bool).tolist()
        refused = set()  # devices of which a command can't start: such a one isn't activated, not in part either
        for i, (actuator, guard) in enumerate(zip(self.graph.actuators, self.guards, strict=True)):
            start = actuator.applied.copy()
            if actuator.command.kind is Kind.POSITION:
                known = bool(np.isfinite(actuator.sent).all())
                if known:
                    start = guard.last_sent()
                if actuator.measured is not None:
                    if not (known and was_active[actuator.device]):
                        start = actuator.measured.copy()
                elif self._put_home[i] and actuator.home is not None:
                    start = actuator.home.copy()
            try:
                guard.reset(start, was_active=was_active[actuator.device])
            except DeviceError as error:
                self.report(str(error))
                self.machine.stop(Fault(Cause.DRIVER_ERROR, actuator.device))
                refused.add(actuator.device)
        for i, actuator in enumerate(self.graph.actuators):
            if actuator.device not in refused:
                self._links[actuator.device] |= LINK_ACTIVE
                self._started[i], self._put_home[i] = True, False
                self._feedback.restart(i)


def by_itself(actuator: Actuator, category: Stop) -> bool:
    """Whether a device does this stop of its positions by itself: torque off, or damping, which no position is."""
    return category in (Stop.LIMP, Stop.DAMP) and actuator.command.kind is Kind.POSITION
