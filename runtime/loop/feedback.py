"""What the feedback of commanded devices shows: limbs that don't follow, drivers that report what can't be, bad starts.

Reads only the row and the guards, so a replay finds the same.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from srl.runtime.contracts.signals import Array, Limits
from srl.runtime.guard import CommandGuard
from srl.runtime.guard.following import FollowingError, usual_window
from srl.runtime.guard.samples import AGREE, SLACK, SPEED
from srl.runtime.ipc.header import DEVICE, LINK_ACTIVE, LINK_CONNECTED, LINK_STALE, Cause
from srl.runtime.loop.machine import Fault
from srl.runtime.profile.following import monitored
from srl.runtime.profile.graph import Actuator, Graph

_PAUSE = 50_000_000  # ns: between two samples no more motion than in this time is believed
_WELL = LINK_ACTIVE | LINK_CONNECTED


class Feedback:
    """Watches every command of a system; see the module's docstring."""

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
