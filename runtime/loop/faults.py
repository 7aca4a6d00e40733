"""What is wrong in a cycle: a device, client or pose that is lost, an emergency input, a limb that does not follow.

Each class reads the row and the guards alone, so a replay finds the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import acos, dist, isfinite, pi, remainder
from typing import Final

import numpy as np

from srl.runtime.contracts.frames import are_pose
from srl.runtime.contracts.signals import Array, Limits
from srl.runtime.guard import CommandGuard
from srl.runtime.guard.following import FollowingError, usual_window
from srl.runtime.guard.samples import AGREE, SLACK, SPEED
from srl.runtime.ipc.header import (
    DEVICE,
    LINK_ACTIVE,
    LINK_CONNECTED,
    LINK_ERROR,
    LINK_FAULT,
    LINK_STALE,
    Cause,
)
from srl.runtime.loop.machine import Fault
from srl.runtime.profile.following import monitored
from srl.runtime.profile.graph import Actuator, Graph, MonitoredPose

_ILL = LINK_CONNECTED | LINK_ERROR | LINK_FAULT | LINK_STALE  # of a device that is well only the first is set
TURNING: Final = 50.0  # rad/s: faster than a hand
SPAN: Final = 0.05  # s: after a longer pause no more motion is accepted than in this time
POSE_SLACK: Final = 0.03, 0.3  # m, rad: noise, and a sample that came late
_PAUSE = 50_000_000  # ns: between two samples no more motion than in this time is accepted
_WELL = LINK_ACTIVE | LINK_CONNECTED


class FaultFinder:
    """Reads the devices' words of the row, and marks there which are stale."""

    def __init__(self, graph: Graph, lost: Callable[[int], None], watch: Callable[[bool], None]) -> None:
        """Takes what it looks at.

        Args:
            graph: the wired system.
            lost: is told of an active device, by index, that is away or at fault.
            watch: is told in each cycle without an emergency whether there is trouble in what a stop depends on.
        """
        self._graph, self._lost, self._watch = graph, lost, watch
        self._stamps, self._links = graph.row.devices[:, DEVICE.stamp], graph.row.devices[:, DEVICE.link]
        self._max_age = self._ages()
        self._poses = PoseMonitor(graph.monitored_poses)
        self._count = len(graph.devices)  # clients come after them
        owners = graph.layout.devices
        self._emergency = [
            (graph.element(e), e.when, owners.index(e.signal.partition(".")[0])) for e in graph.profile.emergency
        ]

    def find(self, now: int) -> Fault | None:
        """The fault of the cycle at `now` (ns): an emergency, or that of the first device that has one."""
        stamps, links = self._stamps.tolist(), self._links.tolist()  # plain integers: each costs a tenth of a numpy one
        fault: Fault | None = None
        trouble = False  # in what the stop depends on
        lost_poses = self._poses.lost(now)
        for i, max_age in enumerate(self._max_age):
            stamp, link = stamps[i], links[i]
            client = i >= self._count
            # A client that has not sent anything yet is not stale. A device without a sample is.
            stale = max_age > 0 and (abs(now - stamp) > max_age if stamp >= 0 else not client)
            stale |= i in lost_poses
            if not stale and link & _ILL == LINK_CONNECTED:
                continue  # the usual: nothing to find
            if stale != bool(link & LINK_STALE):
                link ^= LINK_STALE
                self._links[i] = link
            if link & LINK_ACTIVE and (not link & LINK_CONNECTED or link & LINK_FAULT):
                self._lost(i)
            if not client and self._graph.devices[i].commands:
                trouble |= stale or not link & LINK_CONNECTED or bool(link & (LINK_ERROR | LINK_FAULT))
            if fault is not None:
                continue
            if link & LINK_ERROR:
                fault = Fault(Cause.DRIVER_ERROR, i)
            elif stale or not link & LINK_CONNECTED:
                if self._graph.intent[i]:
                    fault = Fault(Cause.INTENT_LOSS, i)
                elif not client and self._graph.devices[i].commands:
                    fault = Fault(Cause.DEVICE_LOSS, i)
            elif link & LINK_FAULT:
                fault = Fault(Cause.DEVICE_FAULT, i)
        for i, (element, when, device) in enumerate(self._emergency):
            if element[0] == when or not isfinite(element[0]):
                return Fault(Cause.EMERGENCY, i)
            link = self._links.item(device)
            if not link & LINK_CONNECTED or link & LINK_STALE:
                trouble = True
                if fault is None or self.of_client(fault):  # a client's silence doesn't hinder a reset, this does
                    fault = Fault(Cause.DEVICE_LOSS, device)  # a switch that can't be read can't stop anything
        self._watch(trouble)
        return fault

    def of_client(self, fault: Fault | None) -> bool:
        """Whether the fault is a client's silence."""
        return fault is not None and fault.cause is Cause.INTENT_LOSS and fault.fault_source >= self._count

    def _ages(self) -> list[int]:
        """Each device's max_age in ns; 0 for a device that gives nothing that could be stale."""
        ages = [round(d.max_age * 1e9) for d in self._graph.devices]
        for owner in self._graph.layout.devices[len(ages) :]:
            entries = self._graph.profile.setpoints.items()
            ages.append(round(min(e.max_age for n, e in entries if n.startswith(f"{owner}.")) * 1e9))
        return ages


class PoseMonitor:
    """Poses that laws rely on. An occluded, invalid or jumping one is lost, even if its device delivers the others."""

    def __init__(self, each_poses: Sequence[MonitoredPose]) -> None:
        self._poses = each_poses
        self._last: list[list[float] | None] = [None] * len(each_poses)
        self._moved = [0] * len(each_poses)  # ns

    def lost(self, now: int) -> set[int]:
        """The devices, by index, of which a pose is none, never came, or jumps."""
        found = set()
        for i, each in enumerate(self._poses):
            last, pose = self._last[i], each.pose.tolist()
            if pose == last:
                continue
            if not are_pose(pose):
                if last is not None or not each.client:  # a client may not have begun
                    found.add(each.device)
                continue
            if last is not None and _jumps(last, pose, each.speed, min((now - self._moved[i]) * 1e-9, SPAN)):
                found.add(each.device)
            self._last[i], self._moved[i] = pose, now
        return found


def _jumps(a: list[float], b: list[float], speed: float, dt: float) -> bool:
    """Whether two poses, (7,) or (3,) planar, are further apart than a motion in dt seconds."""
    if len(a) == 3:
        way, turn = dist(a[:2], b[:2]), abs(remainder(b[2] - a[2], 2 * pi))
    else:
        way = dist(a[:3], b[:3])
        turn = 2 * acos(min(abs(sum(p * q for p, q in zip(a[3:], b[3:], strict=True))), 1.0))
    return way > speed * dt + POSE_SLACK[0] or (turn > TURNING * dt + POSE_SLACK[1] and speed < float("inf"))


class Feedback:
    """What the feedback of commanded devices shows: limbs that do not follow, false reports, bad starts."""

    def __init__(
        self, graph: Graph, limits: Mapping[str, Limits], guards: Sequence[CommandGuard], report: Callable[[str], None]
    ) -> None:
        """
        Args:
            graph: the wired system.
            limits: by command name.
            guards: by actuator.
            report: takes the text of an event; called rarely.
        """
        self._graph, self._guards, self._report = graph, guards, report
        self._links = graph.row.devices[:, DEVICE.link]
        self._monitors = [_monitor(graph, a, guard) for a, guard in zip(graph.actuators, guards, strict=True)]
        self._reported: dict[int, str] = {}  # by actuator, what of it was reported and is still so
        self._stamps = graph.row.devices[:, DEVICE.stamp]
        self._recent = [deque[tuple[int, Array]](maxlen=AGREE) for a in graph.actuators]
        self._unfit: str | None = None  # the command that was said to be unfit last

    def restart(self, i: int) -> None:
        """Actuator `i` begins to be commanded."""
        if (monitor := self._monitors[i]) is not None:
            monitor.restart()

    def find(self, dt: float) -> Fault | None:
        """The fault of this cycle, dt seconds after the one before: the first command's that has one."""
        fault = None
        for i, (actuator, monitor) in enumerate(zip(self._graph.actuators, self._monitors, strict=True)):
            link = self._links.item(actuator.device)
            if not link & LINK_ACTIVE:
                self._remember(i)
                continue
            self._recent[i].clear()
            if self._guards[i].misreported:
                sent, applied = _numbers(actuator.sent), _numbers(actuator.applied)
                text = f"'{actuator.name}': its driver reports {sent} as sent, which can't have been: it was {applied}"
                fault = fault or Fault(Cause.DEVICE_FAULT, actuator.device)
            elif monitor is not None and link & _WELL == _WELL and monitor.step(dt, bool(link & LINK_STALE)):
                text = self._behind(actuator, monitor)
                fault = fault or Fault(Cause.FOLLOWING_ERROR, actuator.device)
            else:
                if i in self._reported and (monitor is None or monitor.fits()):
                    del self._reported[i]
                continue
            if i not in self._reported:
                self._reported[i] = text
                self._report(text)
        return fault

    def unfit(self) -> Fault | None:
        """Why no command can start from where the limb is measured; None if all can.

        A device that was led up to now is where it was sent, within its window. One that wasn't must be within its
        limits, or beyond them by no more than that.
        """
        for k, (actuator, guard, monitor) in enumerate(
            zip(self._graph.actuators, self._guards, self._monitors, strict=True)
        ):
            if actuator.measured is None:
                continue
            was_active = self._links.item(actuator.device) & LINK_ACTIVE
            q = actuator.measured.ravel()
            if not np.isfinite(q).all():
                if not was_active:
                    continue  # the guard itself refuses to start from what isn't finite
                why = f"'{actuator.name}': not all of its joints are measured"
            elif not was_active and actuator.command.kind == "position" and not self._steady(k):
                why = f"'{actuator.name}': its limb jumps, or is measured now here, now there"
            elif was_active and monitor is not None:
                why = "" if monitor.fits() else self._behind(actuator, monitor)
            elif guard.held_in:
                window = usual_window(actuator.command) if monitor is None else monitor.window
                low, high = np.array(guard.lower) - window, np.array(guard.upper) + window
                i = int(np.argmax(np.maximum(low - q, q - high)))
                inside = low[i] <= q[i] <= high[i]
                range_ = f"{guard.lower[i]:.4g} to {guard.upper[i]:.4g}"
                why = (
                    ""
                    if inside
                    else f"'{actuator.name}': {_name(actuator, i)} is at {q[i]:.4g}, its limits are {range_}"
                )
            else:
                continue
            if why:
                if actuator.name != self._unfit:  # an automatic start asks in each cycle
                    self._report(f"no start: {why}. Bring it there, or look for what measures it wrong; then reset")
                self._unfit = actuator.name
                return Fault(Cause.FOLLOWING_ERROR, actuator.device)
        self._unfit = None
        return None

    def _remember(self, i: int) -> None:
        """Keeps the newest samples of what isn't commanded, with their times (ns)."""
        actuator, recent = self._graph.actuators[i], self._recent[i]
        stamp = self._stamps.item(actuator.device)
        if actuator.measured is not None and stamp >= 0 and (not recent or recent[-1][0] != stamp):
            recent.append((stamp, actuator.measured.ravel().copy()))

    def _steady(self, i: int) -> bool:
        """Whether the newest samples of joints that aren't commanded agree on where they are."""
        recent, command, speed = self._recent[i], self._graph.actuators[i].command, self._guards[i].max_velocity
        slides, usual = command.slides or (), SLACK.get(command.unit, SLACK["rad"])
        slack = np.array([SLACK["m"] if name in slides else usual for name in command.names] or usual)
        return all(
            bool((np.abs(after - before) <= slack + SPEED * np.array(speed) * min(t - s, _PAUSE) * 1e-9).all())
            for (s, before), (t, after) in pairwise(recent)
        )

    def _behind(self, actuator: Actuator, monitor: FollowingError) -> str:
        errors = monitor.errors()
        i = int(np.argmax(np.abs(errors) - monitor.window))
        return (
            f"'{actuator.name}' isn't followed: {_name(actuator, i)} is {errors[i]:+.3g} from where it was commanded "
            f"({monitor.window[i]:.3g} for {monitor.timeout:g} s is normal)"
        )


def _monitor(graph: Graph, actuator: Actuator, guard: CommandGuard) -> FollowingError | None:
    if (found := monitored(graph, actuator)) is None:
        return None
    assert actuator.measured is not None
    window, timeout = found
    speed = np.array(guard.max_velocity)
    return FollowingError(actuator.command, actuator.measured, actuator.applied, speed, window, timeout)


def _name(actuator: Actuator, i: int) -> str:
    names = actuator.command.names
    return names[i] if names else f"element {i}"


def _numbers(values: Array) -> str:
    return ", ".join(f"{v:.4g}" for v in values.ravel().tolist())
