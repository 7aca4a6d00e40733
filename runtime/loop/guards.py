"""The limits that hold for each command of a graph, and the guards that keep to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

import numpy as np

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Limits
from srl.runtime.guard import GUARDS, CommandGuard, IntensityGuard
from srl.runtime.guard.limits import merge
from srl.runtime.profile.graph import Actuator, Graph


def limits_of(graph: Graph) -> dict[str, Limits]:
    """By command name, the narrower of the profile's limits and the devices' own (known once they are open).

    Raises:
        WiringError: a device limits something that is none of its commands, or by another shape.
    """
    found = {}
    for device in graph.devices:
        commands = {c.name: c for c in device.commands}
        for name, limits in device.limits.items():
            place = graph.source.place(f"devices.{device.name}")
            if name not in commands:
                remedy = nearest(name, commands)
                raise WiringError(place, f"its driver limits '{name}', which is none of its commands", remedy)
            for f in fields(limits):
                if (value := getattr(limits, f.name)) is not None and np.shape(value) != commands[name].shape:
                    problem = f"its driver's limit '{f.name}' of '{name}' has shape {np.shape(value)}"
                    raise WiringError(place, problem, f"It must have the command's: {commands[name].shape}")
    for actuator in graph.actuators:
        device = graph.devices[actuator.device]
        own = device.limits.get(actuator.command.name, Limits())
        entry = graph.profile.guard.get(actuator.name)
        place = graph.source.place(f"guard.{actuator.name}")
        command, wanted = actuator.command, Limits()
        if entry is not None:
            wanted = entry.to_limits(command.shape, place, command.labels, command.ordered)
        found[actuator.name] = merge(wanted, own)
    return found


def make_guards(graph: Graph, limits: Mapping[str, Limits]) -> list[CommandGuard]:
    """By actuator, its guard, bound to the row. `limits`: by command name, those of `limits_of`."""
    return [_make_guard(graph, a, limits[a.name]) for a in graph.actuators]


def unbound(graph: Graph, a: Actuator, limits: Limits) -> CommandGuard:
    """The guard of a command, not yet bound to the row.

    Raises:
        WiringError: these limits, or the profile's cues with them, can't be.
    """
    entry = graph.profile.guard.get(a.name)
    place = graph.source.place(f"guard.{a.name}")
    tolerance = entry.tolerance if entry is not None else 1e-3
    make, dt = GUARDS[a.command.kind], float(1 / graph.profile.rate)
    guard = make(place, a.command, limits, dt, rest=a.home, tolerance=tolerance)
    if isinstance(guard, IntensityGuard) and entry is not None:
        guard.take_cues(entry.stop_cue, entry.loss_cue)
    return guard


def _make_guard(graph: Graph, a: Actuator, limits: Limits) -> CommandGuard:
    guard = unbound(graph, a, limits)
    guard.bind(a.applied, a.measured, a.measured_velocity, a.sent, a.gravity)
    if a.cleared is not None:
        cleared = a.cleared
        tracking = cleared.tracking.reshape(a.command.shape)
        times = cleared.timeout, cleared.least_lag, cleared.period
        guard.keep_clear(cleared.clearance, cleared.lag, tracking, *times)
    return guard
