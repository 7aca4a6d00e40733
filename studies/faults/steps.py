"""What was sent in a run, and how large its steps were, as shares of what the guards' limits allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.signals import Array, Kind
from srl.runtime.guard import CommandGuard
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.profile.graph import Actuator, Graph

LONGEST: Final = 5  # periods: a longer pause may not be made up for (runtime/guard/base.py)
ROUNDING: Final = 1e-9  # of the command's unit


@dataclass(frozen=True)
class Sent:
    """What was sent of one command in a run, a row a cycle.

    Attributes:
        values: (k, n), in the command's unit; what left last, NaN before the first.
        left: (k,) bool: a command left in this cycle.
        started: (k,) how many starts and resets there were until then: after each, the command begins anew.
        measured: (k, n) in the same unit; None: not measured, or not the command's own coordinates.
        was_active: (k,) bool: the device was commanded until the cycle before, so a position goes on from what was
            sent.
        time: (k,) s, of each cycle, as the guards counted it: a late cycle may go further.
        dt: s, the period.
    """

    values: Array
    left: NDArray[np.bool_]
    started: NDArray[np.int64]
    measured: Array | None
    was_active: NDArray[np.bool_]
    time: Array
    dt: float


def shares(guard: CommandGuard, sent: Sent) -> Iterator[tuple[int, float, str]]:
    """Yields the cycle, the share of what is allowed (1: all of it), and what is compared, for each that left.

    A step is that of a position by the velocity limit, of a velocity by the acceleration limit, of a torque by the
    limit of its rate, in the time since the last one left. The time counts for as long as the guard may make up for.
    A torque is the whole, with gravity, as the motor feels it.
    What isn't finite is infinitely more than is allowed.
    """
    kind, r = guard.command.kind, np.broadcast_to(np.ravel(guard.command.resolution), guard.size) + ROUNDING
    rate = np.array(
        {Kind.POSITION: guard.max_velocity, Kind.VELOCITY: guard.max_acceleration, Kind.TORQUE: guard.max_effort_rate}[
            kind
        ]
    )
    patience = max((guard.command.period or 0.0) + sent.dt, LONGEST * sent.dt) + sent.dt
    before: int | None = None  # when one left last
    for k in np.flatnonzero(sent.left).tolist():
        now = sent.values[k].ravel()
        if not np.isfinite(now).all():
            yield k, np.inf, "not finite"
            continue
        begins = before is None or sent.started[before] != sent.started[k]
        last = _reference(sent, k, before, begins, kind)
        if last is not None and (now.any() or kind is not Kind.VELOCITY):  # a device that got nothing ends a velocity
            span = (
                sent.dt
                if begins or before is None
                else min(max(float(sent.time[k] - sent.time[before]), sent.dt), patience)
            )
            step = np.abs(now - last)
            yield k, float(np.max(step / (rate * span + 2 * r))), "first step" if begins else "step"
        yield k, _bounds(guard, sent, k, now), "bounds"
        before = k


def _reference(sent: Sent, k: int, before: int | None, begins: bool, kind: Kind) -> Array | None:
    """Where a step is counted from; None: nothing is known."""
    if begins and kind is Kind.VELOCITY:
        return np.zeros_like(sent.values[k].ravel())
    if begins and kind is Kind.TORQUE:
        return None
    if begins and sent.measured is not None and not (sent.was_active[k] and before is not None):
        there = sent.measured[k].ravel()
        return there if np.isfinite(there).all() else None
    if before is None:
        return None
    return sent.values[before].ravel()


def _bounds(guard: CommandGuard, sent: Sent, k: int, now: Array) -> float:
    """A velocity or torque as a share of its limit; 0 for a position, which may begin beyond its limits."""
    if guard.command.kind is Kind.POSITION:
        return 0.0
    most = guard.max_velocity if guard.command.kind is Kind.VELOCITY else guard.max_effort
    limit = np.maximum(np.array(most), ROUNDING) * (1 + 1e-9) + ROUNDING
    return float(np.max(np.abs(now) / limit))


def sent_of(layout: Layout, rows: NDArray[np.int64], graph: Graph, actuator: Actuator, signal: str = "sent") -> Sent:
    """What rows say of one command. `signal`: "applied", where the device's report of what it sent is a lie."""

    def of(name: str) -> Array | None:
        return layout.value(rows, name).reshape(len(rows), -1) if name in layout.fields else None

    words, states = rows[:, layout.device(actuator.device)], rows[:, CYCLE.state]
    left = np.diff(words[:, DEVICE.commands], prepend=words[:1, DEVICE.commands]) > 0
    runs = (states == State.ACTIVE) | (states == State.HOMING)
    values, feedback = of(f"{actuator.name}.{signal}"), actuator.command.feedback
    assert values is not None
    return Sent(
        values, left, np.cumsum(np.diff(runs.astype(np.int64), prepend=0) > 0),
        of(f"{graph.devices[actuator.device].name}.{feedback}") if feedback else None,
        np.roll((words[:, DEVICE.link] & LINK_ACTIVE) != 0, 1),
        np.cumsum(rows[:, CYCLE.dt], dtype=np.float64) * 1e-9, float(1 / graph.profile.rate),
    )  # fmt: skip


def largest(
    layout: Layout, rows: NDArray[np.int64], graph: Graph, guards: list[CommandGuard], misreporting: str = ""
) -> tuple[float, str]:
    """The largest share of what the limits allow in all that was sent, and where that was.

    `misreporting`: a device that reports as sent what wasn't. Of it counts what the guard let through.
    """
    found = [(0.0, "")]
    for actuator, guard in zip(graph.actuators, guards, strict=True):
        signal = "applied" if graph.devices[actuator.device].name == misreporting else "sent"
        for k, share, what in shares(guard, sent_of(layout, rows, graph, actuator, signal)):
            found.append((share, f"{actuator.name}, {what}, cycle {int(rows[k, CYCLE.cycle])}"))
    return max(found)
