"""Devices that carry out a stop by themselves: torque off, or positions that become damping."""

from __future__ import annotations

from collections.abc import Iterable

from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc.header import State
from srl.runtime.loop.cycle import Cycle, by_itself
from srl.runtime.loop.device import Device

_STOPS = (State.STOPPING, State.STOPPED)  # named once: looking a member up takes longer than comparing it


def release(cycle: Cycle, devices: Iterable[Device], now: int) -> list[Device]:
    """Once a stop has begun, tells such devices so, in each cycle; returns those that were told and are still there."""
    if cycle.machine.state not in _STOPS:
        return []
    reported = []
    for device in devices:
        if device.active or device.lost:
            continue
        for actuator in device.actuators:
            category = cycle.category(actuator)
            if category is Stop.LIMP or by_itself(actuator, category):
                device.stop(category, now)
                if not device.lost:
                    reported.append(device)
    return reported
