"""What a cycle watches beside the faults: delivery of commands, what guards reject, clearance, buttons that reset.

Each reads the row alone, so a replay finds the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite, nan
from typing import Any

import numpy as np

from srl.runtime.contracts.clearance import NEVER
from srl.runtime.contracts.signals import Array
from srl.runtime.guard import CommandGuard
from srl.runtime.guard.verified import VerifiedStop
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, LINK_STALE, Origin
from srl.runtime.ipc.requests import Answer, Request, RequestKind
from srl.runtime.profile.graph import Actuator, Graph

LONGEST = 2.0  # s of the same, after which it is the device's fault
STALL = 0.25  # s of restarting at what was sent, after which it is reported
REJECTED = 0.25  # s of commands that aren't finite, after which it is reported
HELD = 0.25  # s of being held, and of not being held, after which it is reported
RELEASED = 50_000_000  # ns for which it was released before a press counts: a contact that is let go bounces, too
BURST = 5  # requests that may come at once
REFILL = 200_000_000  # ns after which one more may come
REPORT_EVERY = 1_000_000_000  # ns between two events about refusals, or about one parameter


class CommandDelivery:
    """Which commands were transmitted. If one was not, its guard restarts from the last transmitted one.

    A guard bounds each command against the one before. If a device took none, or changed it, the one before is what
    the device has, and not what was applied.
    """

    def __init__(self, graph: Graph, guards: Sequence[CommandGuard], report: Callable[[str], None]) -> None:
        """
        Args:
            graph: the wired system.
            guards: by actuator.
            report: takes the text of an event; called rarely.
        """
        self._actuators, self._guards, self._report = graph.actuators, guards, report
        self._links = graph.row.devices[:, DEVICE.link]
        self._commands = graph.row.devices[:, DEVICE.commands]
        self._counts = self._commands.tolist()  # commands sent to each device until the cycle before
        # Of a device with several commands the count doesn't tell which was transmitted: there, one that is new was.
        self._alone = [len(graph.actuators_of(a.device)) == 1 for a in graph.actuators]
        self._sent = [a.sent.tobytes() for a in graph.actuators]  # as it was in the cycle before
        self._stalls = [0.0 for a in graph.actuators]  # s for which its guard has restarted in each cycle
        self._lacks = [0.0 for a in graph.actuators]  # s as above, falling at a quarter of the rate in other cycles

    def update(self, dt: float) -> None:
        """Tells each active guard whether its command of the cycle before was transmitted. `dt`: since then, s."""
        counts = self._commands.tolist()
        for i, (actuator, guard) in enumerate(zip(self._actuators, self._guards, strict=True)):
            transmitted = counts[actuator.device] != self._counts[actuator.device]
            if not self._alone[i]:
                sent = actuator.sent.tobytes()
                transmitted, self._sent[i] = transmitted and sent != self._sent[i], sent
            if self._links.item(actuator.device) & LINK_ACTIVE:
                guard.resynchronise(transmitted, dt)
                self._report_stall(i, guard.resynchronised, dt)
        self._counts = counts

    def stalled(self) -> int:
        """The device, by index, that has taken no commands, or limited or misreported them, for too long; -1: none."""
        for i, actuator in enumerate(self._actuators):
            if self._lacks[i] > LONGEST and self._links.item(actuator.device) & LINK_ACTIVE:
                return actuator.device
        return -1

    def _report_stall(self, i: int, resynchronised: bool, dt: float) -> None:
        """Reports a device that has taken no commands, or limited them all, for a while; and its end."""
        self._lacks[i] = self._lacks[i] + dt if resynchronised else max(self._lacks[i] - dt / 4, 0.0)
        before = self._stalls[i]
        self._stalls[i] = before + dt if resynchronised else 0.0
        name = self._actuators[i].name
        if before <= STALL < self._stalls[i]:
            self._report(f"'{name}' isn't sent as applied: the limb waits where it was sent last")
        elif before > STALL and not resynchronised:
            self._report(f"'{name}' is sent as applied again")


class RejectedCommands:
    """Reports a command that its guard has rejected for a while, in each cycle, since it isn't finite.

    It is asked in those cycles alone in which a guard rejects.
    """

    def __init__(self, graph: Graph, guards: Sequence[CommandGuard], report: Callable[[str], None]) -> None:
        """The arguments are those of `CommandDelivery`."""
        self._graph, self._guards, self._report = graph, guards, report
        self._links = graph.row.devices[:, DEVICE.link]
        self._since = [(-1, 0.0) for a in graph.actuators]  # the last such cycle, and the s up to its end

    def update(self, dt: float) -> None:
        """Ends a cycle in which a guard has rejected its command. `dt`: of this cycle, s."""
        cycle = self._graph.row.ints.item(CYCLE.cycle)
        for i, (actuator, guard) in enumerate(zip(self._graph.actuators, self._guards, strict=True)):
            if not (guard.rejected and self._links.item(actuator.device) & LINK_ACTIVE):
                continue
            asked = (actuator.asked,) if actuator.asked_velocity is None else (actuator.asked, actuator.asked_velocity)
            if all(map(_finite, asked)):
                continue  # a measurement isn't known
            last, before = self._since[i]
            before = before if cycle - last == 1 else 0.0
            self._since[i] = cycle, before + dt
            if before <= REJECTED < before + dt:
                self._report(f"'{actuator.name}' is rejected and its limb held: {self._why(actuator.name)}")

    def _why(self, command: str) -> str:
        """Which law asks what isn't finite, and whether that is due to its inputs."""
        for law in self._graph.laws:
            of_it = [n for n, wire in law.outputs.items() if any(f"{f}.".startswith(f"{command}.") for f in wire.far)]
            if all(_finite(law.controller.output[name]) for name in of_it):
                continue
            unknown = [n for n in law.inputs if not _finite(law.controller.input[n])]
            asks = f"its controller '{law.controller.name}' asks what isn't finite"
            if unknown:
                return f"{asks}, as its input '{unknown[0]}' ({', '.join(law.inputs[unknown[0]].far)}) isn't"
            return f"{asks}, though its inputs are: it keeps a NaN. Stop it and reset it"
        return "it isn't finite"


class ClearanceMonitor:
    """Gives a command's clearance what it looks at, with its age, and reports why the limb is held."""

    def __init__(self, graph: Graph, actuator: Actuator, report: Callable[[str], None]) -> None:
        self._row, self._actuator, self._report = graph.row, actuator, report
        self._stamps, self._links = graph.row.devices[:, DEVICE.stamp], graph.row.devices[:, DEVICE.link]
        self._held = self._free = 0.0  # s
        self._reported = False

    def look(self, verified: VerifiedStop, ran: bool) -> None:
        """Begins a cycle. ran: all laws have computed their outputs in it."""
        cleared = self._actuator.cleared
        assert cleared is not None
        for index, array in cleared.copies:
            self._row.floats.take(index, 0, array, "clip")
        now = self._row.ints.item(CYCLE.now)
        stamps = {}
        for name, devices in cleared.devices.items():
            usable = ran or name not in cleared.computed
            stamps[name] = min(map(self._stamp, devices)) if usable else NEVER
        taken = self._stamps.item(self._actuator.device)
        verified.begin(now, stamps, max(now - taken, 0) * 1e-9 if taken >= 0 else 0.0)

    def update(self, verified: VerifiedStop, dt: float) -> None:
        """Ends a cycle: writes the margin, and reports when the limb is held and when no longer."""
        actuator = self._actuator
        assert actuator.margin is not None
        actuator.margin[0] = verified.margin
        self._held, self._free = (self._held + dt, 0.0) if verified.held else (0.0, self._free + dt)
        if self._held > HELD and not self._reported:
            self._reported = True
            self._report(f"'{actuator.name}' is held: {verified.why}")
        elif self._free > HELD and self._reported:
            self._reported = False
            self._report(f"'{actuator.name}' is held no longer")

    def rest(self) -> None:
        """In a cycle in which nothing is commanded: the limb may go anywhere."""
        if self._actuator.cleared is not None:
            self._actuator.cleared.clearance.extent = None
        if self._actuator.margin is not None:
            self._actuator.margin[0] = nan

    def _stamp(self, device: int) -> int:
        """When a device's newest sample was taken; NEVER for one that is lost or stale."""
        link = self._links.item(device)
        return self._stamps.item(device) if link & LINK_CONNECTED and not link & LINK_STALE else NEVER


class ResetInputs:
    """Buttons that reset (`reset.inputs`). A press counts, a button that is held or stuck never does.

    Attributes:
        pressed: index of the input whose press waits for the next cycle; -1: none.
        limit: how many presses may ask.
    """

    def __init__(self, graph: Graph) -> None:
        self._inputs = []
        for entry in graph.profile.reset.inputs:
            words = graph.row.devices[graph.layout.devices.index(entry.signal.partition(".")[0])]
            self._inputs.append((graph.element(entry), entry.when, words))
        # ns, since when each was seen released without a break, in this stop and since its device came back; -1: not
        self._since = [-1] * len(self._inputs)
        self._old = [-1] * len(self._inputs)  # stamp of the sample that a lost device left behind
        self.pressed = -1
        self.limit = TokenBucket()

    def look(self, now: int, stopped: bool) -> None:
        """Looks for a press. Called once a cycle, once staleness is known.

        Args:
            now: ns.
            stopped: the limb is in a stop, which didn't get a new cause in this cycle.
        """
        for i, (element, when, words) in enumerate(self._inputs):
            link, stamp = words.item(DEVICE.link), words.item(DEVICE.stamp)
            if not link & LINK_CONNECTED:
                self._old[i] = stamp
            if not stopped or not link & LINK_CONNECTED or link & LINK_STALE or stamp in (-1, self._old[i]):
                self._since[i] = -1
                continue
            value = element.item()
            if value != when and isfinite(value):
                if self._since[i] < 0:
                    self._since[i] = now
                continue
            if value == when and self._since[i] >= 0 and now - self._since[i] >= RELEASED:
                self.pressed = i
            self._since[i] = -1

    def take(self) -> int:
        """Returns the index of the input that was pressed, and forgets it; -1: none."""
        taken, self.pressed = self.pressed, -1
        return taken


def _finite(values: Array) -> bool:
    return bool(np.isfinite(values).all())


class TokenBucket:
    """A limit on how often something may happen: up to `BURST` tokens, one more each `REFILL` ns. It begins full.

    The same times give the same answers.
    """

    def __init__(self) -> None:
        self._level, self._last = BURST * REFILL, 0

    def take(self, now: int) -> bool:
        """Takes a token; False if there is none. `now`: ns."""
        self._level = min(self._level + now - self._last, BURST * REFILL)
        self._last = now
        if self._level < REFILL:
            return False
        self._level -= REFILL
        return True


def described(kind: RequestKind, origin: Origin, uid: int) -> str:
    """A request in words: "reset (local, user 1000)"."""
    return f"{kind.name.lower()} ({origin.name.lower()}" + (f", user {uid})" if uid >= 0 else ")")


class Refusals:
    """Counts refused requests, and reports them at most once a second."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._count, self._last, self._next = 0, "", 0

    def add(self, count: int, what: str) -> None:
        """Adds `count` refusals; `what` describes the last of them."""
        self._count += count
        self._last = what

    def turn(self, now: int) -> None:
        """Reports what was added, if an event is due. Called once a cycle; `now` in ns."""
        if self._count and now >= self._next:
            self._report(f"refused: {self._last}" + (f"; {self._count} since the last such event" * (self._count > 1)))
            self._count, self._next = 0, now + REPORT_EVERY


class ParameterChanges:
    """Who changed which parameter, from what to what: reported at once, and then at most once a second for each."""

    def __init__(self, parameters: Sequence[Mapping[str, Any]]) -> None:
        """`parameters`: those of the layout, in the order of the requests' targets."""
        self._parameters = parameters
        self._waiting: dict[int, tuple[float, float, str]] = {}  # by target: from, to, who
        self._next = [0] * len(parameters)  # ns

    def add(self, request: Request, before: float) -> None:
        """A request has changed its target, which was `before`."""
        value, origin = float(request.values[0]), request.origin.name.lower()
        who = f"'{request.sender}' ({origin})" if request.sender else f"a client ({origin})"
        first = self._waiting.get(request.target, (before,))[0]
        self._waiting[request.target] = first, value, who

    def due(self, now: int) -> list[str]:
        """Texts of events that are due. Called once a cycle; `now` in ns."""
        if not self._waiting:
            return []
        found = []
        for target in [t for t in self._waiting if now >= self._next[t]]:
            before, value, who = self._waiting.pop(target)
            name, unit = (self._parameters[target][key] for key in ("name", "unit"))
            said = "" if unit == "1" else f" {unit}"
            found.append(f"parameter '{name}': {before:.6g} -> {value:.6g}{said}, changed by {who}")
            self._next[target] = now + REPORT_EVERY
        return found


def refusal(kind: RequestKind, origin: Origin, uid: int, answer: Answer) -> str:
    """A refused request in words: "reset (bus): refused_latch"."""
    return f"{described(kind, origin, uid)}: {answer.name.lower()}"
