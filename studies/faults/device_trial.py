"""One trial: a profile on its fakes, in lockstep, and one device that fails at a random instant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Kind
from srl.runtime.guard import CommandGuard
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.testing.lab import Lab
from srl.studies.faults import device_faults
from srl.studies.faults.device_faults import CLIENT, JUMPS, LATE, Expected
from srl.studies.faults.steps import ROUNDING, largest, sent_of
from srl.studies.tasks.task import Value

WARM: Final = (0.2, 0.9)  # s of motion before the fault
LASTS: Final = 0.4  # s for which a fault goes on after what is expected of it
HEALED: Final = 0.3  # s after the fault's end in which nothing may move by itself
AGAIN: Final = 0.3  # s of motion after the reset
MOST: Final = 12.0  # s of world time until it moves again: a limb without feedback goes home slowly
ASK: Final = 0.25  # s between a person's resets
TURN: Final = 0.4  # s after which a simulated client asks for another setpoint
MOVES: Final = 0.02  # of what a step may be: less is rounding


class Bench(Lab):
    """The lab, with its parts open to the campaign, and a client that sends setpoints where the profile wants them."""

    def __init__(self, given: str, overrides: list[str], seed: int) -> None:
        super().__init__(given, overrides)
        self.graph, self.machine_cycle = self._graph, self._lockstep.cycle
        self.guards: list[CommandGuard] = self.machine_cycle.guards
        self.dt = self._lockstep.period * 1e-9
        self.random = np.random.default_rng(seed)
        self.mute = False  # the client
        self.wild = False  # it asks for what can't be
        self._next = 0.0
        self._names = [entry["name"] for entry in self.layout.meta["setpoints"]]

    def _cycle(self, kind: Any) -> None:
        if self._names and self.time >= self._next:
            self._next = self.time + TURN
            for name in self._names:
                self.setpoint(name, None if self.mute else self._wish(name))
        super()._cycle(kind)

    def _wish(self, name: str) -> Any:
        shape = self.layout.fields[name].shape
        if self.wild:
            return self.random.choice((-1e6, 1e6), shape)
        guard = self.guards[0]
        if guard.command.kind is Kind.POSITION:
            low, high = np.maximum(guard.lower, -0.5), np.minimum(guard.upper, 1.0)
        else:
            high = 0.4 * np.array(guard.max_velocity)
            low = -high
        wish = self.random.uniform(low, high)
        return wish.reshape(shape) if wish.size == int(np.prod(shape)) else np.full(shape, wish[0])

    def begin(self) -> None:
        """Runs until the limb moves. Raises AssertionError."""
        self.run(0.1)
        if self.state == "ready":
            self.start()
        self.until("active", most=MOST)

    def moved(self, begin: int) -> float:
        """How far what is sent went since a cycle, as a share of what one cycle may; only positions and velocities."""
        most = 0.0
        for actuator, guard in zip(self.graph.actuators, self.guards, strict=True):
            found = sent_of(self.layout, self.rows, self.graph, actuator)
            # What didn't leave hasn't moved anything; a row shows what left last.
            sent = found.values[begin:][found.left[begin:]]
            if guard.command.kind is Kind.TORQUE or not len(sent):
                continue
            r = 2 * np.broadcast_to(np.ravel(guard.command.resolution), guard.size) + 1e-9
            if guard.command.kind is Kind.POSITION:
                off, unit = np.abs(sent - sent[0]).max(axis=0), np.array(guard.max_velocity) * self.dt
            else:
                off, unit = np.abs(sent).max(axis=0), np.array(guard.max_velocity)
            most = max(most, float(np.max(np.maximum(off - r, 0.0) / unit)))
        return most


def trial(profile: str, parameters: Mapping[str, Any], seed: int) -> dict[str, Value]:
    """Runs one trial; parameters: `profile` (a name, whose text is `profile`), `choices`, `device`, `fault`."""
    rng = np.random.default_rng(seed)
    overrides = [*parameters["choices"], f"seed={seed}"]
    with Bench(parameters["profile"], overrides, seed) as bench:
        bench.begin()
        bench.run(float(rng.uniform(*WARM)))
        if bench.state != "active":
            raise RequestError("trial", f"it stopped before the fault: {bench.situation()}", "Look at the profile")
        return _break(bench, parameters["device"], parameters["fault"])


def expectation(bench: Bench, device: str, kind: str) -> Expected:
    """What must be if this device, or the client, has this fault."""
    names = [d.name for d in bench.graph.devices]
    if device != CLIENT:
        return device_faults.expected(bench.graph, bench.guards, names.index(device), kind)
    if kind != "silent":
        return Expected(None, False, 0.0, 0.0)
    age = max(entry.max_age for entry in bench.graph.profile.setpoints.values())
    slack = device_faults.SLACK * bench.dt
    ramp = max(device_faults.ramp_of(guard) for guard in bench.guards)
    return Expected(Cause.INTENT_LOSS, False, age + TURN + slack, age + TURN + slack + ramp + slack)


def _break(bench: Bench, device: str, kind: str) -> dict[str, Value]:
    due, started = expectation(bench, device, kind), bench.cycles
    _fault(bench, device, kind)
    bench.run(max(due.safe, due.still or 0.0) + LASTS)
    end = bench.time + MOST
    while bench.state == "stopping" and bench.time < end:  # what stopped it came late, as a robot's own reflex may
        bench.step()
    rows = bench.rows[started:]
    causes, states = rows[:, CYCLE.cause], rows[:, CYCLE.state]
    seen, safe = _first(causes != Cause.NONE), _first(states == State.STOPPED)
    cause, fault_source = bench.cause, bench.fault_source
    wrong = _judge(bench, due, seen, safe, device)
    stopped = bench.state in ("stopping", "stopped")
    if due.still is not None and (went := bench.moved(started + round(due.still / bench.dt))) > MOVES:
        wrong.append(f"what is sent goes on by {went:.3g} of a step")
    if stopped and due.cause is not None and device != CLIENT:
        bench.reset()
        if bench.state not in ("stopping", "stopped"):
            wrong.append("a reset is granted while the fault is there")
    wrong += _recovers(bench, device, stopped)
    liar = device if kind == "misreporting" else ""
    share, where = largest(bench.layout, bench.rows, bench.graph, bench.guards, misreporting=liar)
    if not share <= 1.0 + ROUNDING:
        wrong.append(f"{share:.3g} of what the limits allow was sent: {where}")
    recorded = seen is None or (cause != "none" and fault_source != "")  # the rows say why, and whose fault it is
    return {
        "entered": "stopped" if stopped else "active", "cause": cause, "fault_source": fault_source,
        "seen": None if seen is None else seen * bench.dt, "safe": None if safe is None else safe * bench.dt,
        "due": due.safe if due.cause is not None else None, "step": share, "where": where, "recorded": recorded,
        "cycles": bench.cycles, "wrong": "; ".join(wrong),
    }  # fmt: skip


def _fault(bench: Bench, device: str, kind: str) -> None:
    if device == CLIENT:
        bench.mute, bench.wild = kind == "silent", kind == "garbage"
        return
    age = next(d.max_age for d in bench.graph.devices if d.name == device)
    if kind in LATE:
        bench.fault(device, "late", LATE[kind] * age)
    elif kind in JUMPS:
        bench.fault(device, "clock-jump", JUMPS[kind])
    else:
        bench.fault(device, kind)


def _judge(bench: Bench, due: Expected, seen: int | None, safe: int | None, device: str) -> list[str]:
    """What isn't as it is due."""
    if due.goes_on:
        return [f"it stopped: {bench.cause} of {bench.fault_source}"] if seen is not None else []
    if due.cause is None:
        return []
    wrong = []
    if seen is None:
        return [f"it went on, and {due.cause.name.lower()} is due"]
    if bench.cause != due.cause.name.lower():
        wrong.append(f"the cause is {bench.cause}, and {due.cause.name.lower()} is due")
    if bench.fault_source != device:
        wrong.append(f"the fault source is '{bench.fault_source}'")
    if seen * bench.dt > due.seen:
        wrong.append(f"the stop begins after {seen * bench.dt:.3f} s, {due.seen:.3f} s is due")
    if safe is None or safe * bench.dt > due.safe:
        wrong.append(
            f"at rest {'never' if safe is None else f'after {safe * bench.dt:.3f} s'}, {due.safe:.3f} s is due"
        )
    return wrong


def _recovers(bench: Bench, device: str, stopped: bool) -> list[str]:
    """Ends the fault; a stopped limb must stand until it is reset, and then go on."""
    if device == CLIENT:
        bench.mute = bench.wild = False
    else:
        bench.heal(device)
    started = bench.cycles
    if not stopped:
        bench.run(AGAIN)
        return []
    if device != CLIENT:
        bench.until(lambda: bench.connected(device), most=MOST)
    bench.run(HEALED)
    wrong = []
    if bench.state not in ("stopping", "stopped"):
        wrong.append("it began again by itself")
    if (went := bench.moved(started)) > MOVES:
        wrong.append(f"after the fault's end what is sent moved by {went:.3g} of a step without a reset")
    end = bench.time + MOST
    while bench.state != "active" and bench.time < end:
        if bench.state == "stopped":
            bench.reset()  # a device at fault is told to recover, which takes as long as it takes, and then goes on
        bench.run(ASK)
    if bench.state != "active":
        return [*wrong, f"it doesn't begin again: {bench.situation()}"]
    bench.run(AGAIN)
    return wrong


def _first(found: Any) -> int | None:
    where = np.flatnonzero(found)
    return int(where[0]) + 1 if len(where) else None
