"""The faults of devices in the campaign, and what is expected of each: written before the campaign ran."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from srl.runtime.contracts.plausible import plausible
from srl.runtime.contracts.signals import Kind
from srl.runtime.guard import CommandGuard
from srl.runtime.guard.base import LONGEST
from srl.runtime.ipc.header import Cause
from srl.runtime.profile.graph import Graph

CLIENT: Final = "client"  # who sends setpoints over the bus
LATE: Final = {"late-little": 0.4, "late": 3.0}  # times the device's `max_age`
JUMPS: Final = {"clock-forward": 10.0, "clock-back": -10.0}  # s
SILENCES: Final = ("silent", "disconnected", "late", *JUMPS)
VALUES: Final = ("frozen", "nan", "garbage", "out-of-range", "wrong-sample")
KINDS: Final = {
    "silent": "connected, and nothing comes any more",
    "frozen": "samples come, their values stand still",
    "nan": "samples come, every value is NaN",
    "garbage": "samples come, each with other numbers up to a million",
    "out-of-range": "samples come, every value is a million",
    "wrong-sample": "one sample has values beyond all reason",
    "drifting": "what is measured of its joints drifts away by 0.6 rad (m) a second",
    "misreporting": "it reports as sent what wasn't",
    "late-little": "samples come late by 0.4 of `max_age`",
    "late": "samples come late by three times `max_age`",
    "clock-forward": "the samples' stamps jump 10 s ahead",
    "clock-back": "the samples' stamps jump 10 s back",
    "disconnected": "gone, as with the cable pulled out",
    "deaf": "takes no commands, as with a link that stalls",
    "refusing": "connected, and refuses to move",
}
RAMP: Final = 2.0  # s that a torque's damping may take until all is at rest
DRIFTS: Final = 3.5  # s in which a drift of 0.6 rad a second must have been found
MILLION: Final = 1e6
SLACK: Final = 6  # periods, for the loop's own order of things and the end of a ramp


@dataclass(frozen=True)
class Expected:
    """What must be, after a fault.

    Attributes:
        cause: why it stops; None: it may stop or go on, as the laws decide.
        goes_on: it must not stop.
        seen: s in which the stop must have begun.
        safe: s in which it must be complete.
        still: s, after which nothing that is sent may change any more while the fault lasts; None: it may.
    """

    cause: Cause | None
    goes_on: bool
    seen: float
    safe: float
    still: float | None = None


def kinds_of(graph: Graph, device: int) -> list[str]:
    """The faults that this device can have, in the catalogue's order."""
    driver = graph.devices[device]
    found = []
    for kind in KINDS:
        if kind in ("deaf", "refusing", "misreporting"):
            if driver.commands:
                found.append(kind)
        elif kind == "drifting":
            if _followed(graph, device):
                found.append(kind)
        elif kind == "disconnected" or (driver.states and (kind in VALUES or driver.max_age > 0)):
            found.append(kind)
    return found


def expected(graph: Graph, guards: list[CommandGuard], device: int, kind: str) -> Expected:
    """What must be if this device has this fault."""
    dt = float(1 / graph.profile.rate)
    slack = SLACK * dt
    driver = graph.devices[device]
    ramp = max((ramp_of(g) for g in guards), default=0.0)
    if kind in SILENCES:
        # A jump is seen in the next sample, at the latest when the one before it is stale.
        seen = slack if kind == "disconnected" else driver.max_age + slack
        cause = _cause_of_loss(graph, device)
        return Expected(cause, cause is None, seen, seen + ramp + slack)
    if kind == "refusing":
        return Expected(Cause.DEVICE_FAULT, False, slack, ramp + 2 * slack)
    if kind == "wrong-sample":  # the one before stays, and no limb takes notice
        return Expected(None, True, 0.0, 0.0)
    if kind == "out-of-range" and driver.max_age > 0 and any((plausible(s)[1] < MILLION).any() for s in driver.states):
        cause, seen = _cause_of_loss(graph, device), driver.max_age + slack  # no sample: the one before grows old
        return Expected(cause, cause is None, seen, seen + ramp + slack)
    if kind == "misreporting":
        seen = max(max((a.command.period or 0.0) + dt, LONGEST * dt) for a in graph.actuators_of(device)) + slack
        return Expected(Cause.DEVICE_FAULT, False, seen, seen + ramp + slack)
    if kind == "drifting":
        seen = DRIFTS + slack
        return Expected(Cause.FOLLOWING_ERROR, False, seen, seen + ramp + slack)
    if kind == "late-little" and not _clears(graph, device):
        return Expected(None, True, 0.0, 0.0)
    if kind in ("frozen", "nan") and _clears(graph, device):
        return Expected(None, False, 0.0, 0.0, still=1.0 + ramp)
    return Expected(None, False, 0.0, 0.0)


def _followed(graph: Graph, device: int) -> bool:
    """Whether what it measures of its joints is compared with what is commanded."""
    return any(a.measured is not None and a.command.kind is not Kind.TORQUE for a in graph.actuators_of(device))


def _clears(graph: Graph, device: int) -> bool:
    """Whether a limb keeps clear of what this device measures."""
    return any(device in found for cleared in graph.clearances.values() for found in cleared.devices.values())


def _cause_of_loss(graph: Graph, device: int) -> Cause | None:
    if graph.intent[device]:
        return Cause.INTENT_LOSS
    name = graph.devices[device].name
    emergency = any(entry.signal.partition(".")[0] == name for entry in graph.profile.emergency)
    return Cause.DEVICE_LOSS if graph.devices[device].commands or emergency else None


def ramp_of(guard: CommandGuard) -> float:
    """s that a stop from the fastest motion takes at most, by the guard's own limits."""
    if guard.command.kind is Kind.TORQUE:
        return RAMP
    ramps = []
    for v, a, j in zip(guard.max_velocity, guard.max_acceleration, guard.max_jerk, strict=True):
        ramps.append(v / a + (2 * a / j if j < float("inf") else 0.0))
    return max(ramps)
