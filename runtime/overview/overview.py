"""A wired system as plain data, for people and programs that look at it: `srl check --all`.

Everything is of JSON types. Numbers that aren't finite are None: nothing bounds them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any

import numpy as np

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.signals import Command, Kind, Limits, Signal
from srl.runtime.contracts.terms import FORCE, POINT, TWIST
from srl.runtime.guard.following import window_of
from srl.runtime.guard.limits import INTENSITY, NAMES
from srl.runtime.overview.frames import frames, models, parts
from srl.runtime.profile import start_mode
from srl.runtime.profile.connections import Connection, reading, transforms, untaken, writing
from srl.runtime.profile.following import monitored
from srl.runtime.profile.graph import Actuator, Graph, Law
from srl.runtime.profile.names import Link

Item = dict[str, Any]
_STRAIGHT = {*POINT, *TWIST[:3], *FORCE}
"""The elements that have the first of a signal's two units: "m, rad"."""
_PER = {"velocity": "/s", "acceleration": "/s^2", "jerk": "/s^3"}


def overview(graph: Graph, limits: Mapping[str, Limits]) -> Item:
    """Returns the whole system.

    Args:
        graph: as it is wired.
        limits: by command name, those of the guard (`srl.runtime.loop.guards.limits_of`).
    """
    profile = graph.profile
    return {
        "profile": profile.name,
        "summary": profile.summary,
        "rate_hz": float(profile.rate),
        "clock": profile.clock,
        "start": start_mode.start(graph),
        "unseen": start_mode.unseen(graph),
        "chosen": dict(graph.source.chosen),
        "simulated": list(graph.simulated),
        "devices": [_device(graph, device) for device in graph.devices],
        "clients": _clients(graph),
        "laws": [_law(graph, law) for law in graph.laws],
        "commands": [_command(graph, actuator, limits[actuator.name]) for actuator in graph.actuators],
        "stops": _stops(graph),
        "frames": frames(graph),
        "parts": [{"name": name, **part} for name, part in parts(graph).items()],
        "models": models(graph),
        "untaken": untaken(graph),
        "warnings": list(graph.warnings),
        "remarks": list(graph.remarks),
    }


def number(value: float | None) -> float | None:
    """The number, or None where it bounds nothing."""
    return None if value is None or not isfinite(value) else float(value)


def _signal(name: str, signal: Signal) -> Item:
    return {
        "name": name,
        "shape": list(signal.shape),
        "unit": signal.unit,
        "frame": signal.frame,
        "of": signal.of,
        "elements": list(signal.names),
        "components": [list(names) for names in signal.components],
        "slots": signal.slots,
        "slides": list(signal.slides or ()),
    }


def _device(graph: Graph, device: Driver) -> Item:
    entry = graph.profile.devices[device.name]
    return {
        "name": device.name,
        "driver": entry.driver,
        "port": getattr(device.config, "port", None),
        "simulated": device.name in graph.simulated,
        "paces": graph.profile.clock == device.name,
        "max_age": number(device.max_age) or None,
        "links": [f"{device.name}/{link}" for link in device.links],
        "states": [_signal(f"{device.name}.{state.name}", state) for state in device.states],
        "commands": [
            _signal(f"{device.name}.{command.name}", command)
            | {
                "kind": str(command.kind.value),
                "feedback": f"{device.name}.{command.feedback}" if command.feedback else None,
                "home": _by_element(command, device.home.get(command.name)),
                "period": number(command.period),
            }
            for command in device.commands
        ],
    }


def _clients(graph: Graph) -> list[Item]:
    return [_field(graph, name) | {"max_age": number(entry.max_age)} for name, entry in graph.profile.setpoints.items()]


def _field(graph: Graph, name: str) -> Item:
    field = graph.layout.fields[name]
    return {
        "name": name,
        "shape": list(field.shape),
        "unit": field.unit,
        "frame": field.frame,
        "elements": list(field.labels),
    }


def _law(graph: Graph, law: Law) -> Item:
    controller = law.controller
    entry = graph.profile.controllers[graph.laws.index(law)]
    commands = {actuator.name for actuator in graph.actuators}
    needs = {f"{controller.name}.{found.need.name}" for found in law.transforms}
    return {
        "name": controller.name,
        "use": entry.use,
        "summary": controller.summary,
        "reads": [_wire(name, wire, reading(graph, wire)) for name, wire in law.inputs.items()],
        "needs": [transform for transform in transforms(graph) if transform["name"] in needs],
        "writes": [
            _wire(name, wire, writing(graph, wire)) | {"commands": [far for far in wire.far if far in commands]}
            for name, wire in law.outputs.items()
        ],
        "parameters": [
            {
                "name": f"{controller.name}.{p.name}",
                "default": number(p.default),
                "lower": number(p.lower),
                "upper": number(p.upper),
                "unit": p.unit,
                "text": p.text,
            }
            for p in controller.parameters
        ],
    }


def _wire(port: str, wire: Link, connection: Connection) -> Item:
    """A wire: the law's own port, the signals at the other end, and pairs of elements whose names or order differ."""
    return {
        "port": port,
        "signals": list(wire.far),
        "form": connection.form,
        "elements": [list(pair) for pair in connection.elements],
    }


def _command(graph: Graph, actuator: Actuator, limits: Limits) -> Item:
    command, cleared = actuator.command, actuator.cleared
    entry = graph.profile.guard.get(actuator.name)
    clear = entry.clear if entry is not None else None
    return {
        "name": actuator.name,
        "device": graph.devices[actuator.device].name,
        "kind": str(command.kind.value),
        "unit": command.unit,
        "stop": str(actuator.category.value),
        "writers": [
            law.controller.name for law in graph.laws if any(actuator.name in w.far for w in law.outputs.values())
        ],
        "limits": {
            name: {
                "values": _by_element(command, value),
                "units": {element: _limit_unit(command, name, element) for element in _elements(command)},
            }
            for name in NAMES
            if (value := getattr(limits, name)) is not None
        },
        "following_error": _following(graph, actuator, limits),
        "clear": None
        if cleared is None or clear is None
        else {
            "use": clear.use,
            "summary": cleared.clearance.summary,
            "reads": [_wire(name, wire, reading(graph, wire)) for name, wire in cleared.inputs.items()],
            "lag": number(cleared.lag),
            "tracking": _by_element(command, cleared.tracking),
            "options": cleared.clearance.config.model_dump(mode="json", exclude_unset=True),
        },
    }


def _following(graph: Graph, actuator: Actuator, limits: Limits) -> Item | None:
    """How far the limb may be from its command, and for how long (s); None if nothing is monitored."""
    if (found := monitored(graph, actuator)) is None:
        return None
    command, (given, timeout) = actuator.command, found
    speed = np.zeros(command.size) if limits.velocity is None else np.ravel(limits.velocity)
    return {"window": _by_element(command, window_of(command, speed, given).reshape(command.shape)), "timeout": timeout}


def _elements(command: Command) -> tuple[str, ...]:
    """A name for each number of a command."""
    return command.names if len(command.names) == command.size else tuple(map(str, range(command.size)))


def _by_element(command: Command, values: Any) -> dict[str, float | None] | None:
    if values is None:
        return None
    flat = np.broadcast_to(np.asarray(values, np.float64), command.shape).ravel()
    return {name: number(value) for name, value in zip(_elements(command), flat.tolist(), strict=True)}


def _limit_unit(command: Command, limit: str, element: str) -> str:
    """The unit of one element's limit: those of a position, whatever is commanded, and its rates."""
    straight, _, turned = command.unit.partition(", ")
    own = turned if turned and element not in _STRAIGHT else straight
    if limit in INTENSITY:
        return {"level_rate": "1/s", "on_time": "s"}.get(limit, "1")
    if limit in ("effort", "effort_rate", "inertia"):
        slides = element in (command.slides or ()) or own == "N"
        return {
            "effort": "N" if slides else "N m", "effort_rate": "N/s" if slides else "N m/s",
            "inertia": "kg" if slides else "kg m^2",
        }[limit]  # fmt: skip
    place = {Kind.POSITION: own, Kind.VELOCITY: own.removesuffix("/s"), Kind.TORQUE: "m" if own == "N" else "rad"}
    unit = place[command.kind]
    if unit == "rad" and element in (command.slides or ()):
        unit = "m"
    return unit + _PER.get(limit, "")


def _stops(graph: Graph) -> Item:
    """What stops the limb: emergency inputs, losses, reactions; and what lets it move again."""
    names = graph.layout.devices
    clocks = {device.name: device.max_age for device in graph.devices}
    clocks |= {name.partition(".")[0]: entry.max_age for name, entry in graph.profile.setpoints.items()}
    return {
        "emergency": [
            {**_button(graph, entry.signal, entry.element), "when": entry.when, "category": str(entry.category)}
            for entry in graph.profile.emergency
        ],
        "intent_of": [
            {"name": name, "max_age": number(clocks.get(name)) or None}
            for name, intent in zip(names, graph.intent, strict=True)
            if intent
        ],
        "reactions": graph.profile.faults.model_dump(mode="json", by_alias=True)
        | {"overrun": graph.profile.faults.overrun.at(graph.profile.rate).model_dump()},
        "reset": [
            {**_button(graph, entry.signal, entry.element), "when": entry.when} for entry in graph.profile.reset.inputs
        ],
    }


def _button(graph: Graph, signal: str, element: str | None) -> Item:
    labels: Iterable[str] = graph.layout.fields[signal].labels
    return {"signal": signal, "element": element or next(iter(labels), None)}
