"""What is connected in a wired system, and what nothing takes: for `srl check` and `srl check --all`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from srl.runtime.contracts.field import Field
from srl.runtime.profile.builder import form
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.names import Link


@dataclass(frozen=True)
class Connection:
    """One wire of a controller or clearance.

    Attributes:
        start, end: full names; joined by " + " where there are several.
        form: shape, unit and frame.
        elements: (element at the start, at the end), where they aren't all of the same name in the same order.
    """

    start: str
    end: str
    form: str
    elements: tuple[tuple[str, str], ...]


def connections(graph: Graph) -> list[Connection]:
    """Returns every wire: the controllers' in their order, then the clearances'."""
    found = []
    for law in graph.laws:
        found += [reading(graph, wire) for wire in law.inputs.values()]
        found += [writing(graph, wire) for wire in law.outputs.values()]
    for cleared in graph.clearances.values():
        found += [reading(graph, wire) for wire in cleared.inputs.values()]
    return found


def reading(graph: Graph, wire: Link) -> Connection:
    """The wire of an input: from signals to the input."""
    return Connection(" + ".join(wire.far), wire.name, form(wire.near), tuple(_pairs(graph, wire)))


def writing(graph: Graph, wire: Link) -> Connection:
    """The wire of an output: from the output to signals."""
    pairs = tuple((mine, theirs) for theirs, mine in _pairs(graph, wire))
    return Connection(wire.name, " + ".join(wire.far), form(wire.near), pairs)


def transforms(graph: Graph) -> list[dict[str, Any]]:
    """Returns the transforms that the laws were given, with where they come from."""
    return [
        {
            "name": f"{law.controller.name}.{found.need.name}",
            "text": found.need.text,
            "of": found.path.source,
            "into": found.path.target,
            "position": list(found.pose[:3]),
            "quaternion": list(found.pose[3:]),
            "from": found.origin,
            "measured_by": list(found.signals),
        }
        for law in graph.laws
        for found in law.transforms
    ]


def untaken(graph: Graph) -> list[str]:
    """Returns what devices and clients give and nothing takes: signals, or elements of signals taken in part."""
    taken: dict[str, set[int]] = {}
    whole = {name for law in graph.laws for found in law.transforms for name in found.signals}
    wires = [wire for law in graph.laws for wire in law.inputs.values()]
    for wire in [*wires, *(wire for cleared in graph.clearances.values() for wire in cleared.inputs.values())]:
        if wire.rows is None:
            whole.add(wire.far[0])
        for name, row in wire.rows or ():
            taken.setdefault(name, set()).add(row)
    for actuator in graph.actuators:
        device = graph.devices[actuator.device].name
        whole |= {f"{device}.{actuator.command.feedback}", f"{device}.velocity"}
    for entry in (*graph.profile.emergency, *graph.profile.reset.inputs):
        labels = graph.layout.fields[entry.signal].labels
        taken.setdefault(entry.signal, set()).add(labels.index(entry.element) if entry.element and labels else 0)
    found = []
    for field in graph.layout.fields.values():
        if field.role not in ("state", "setpoint") or field.name in whole:
            continue
        if field.name not in taken:
            found.append(field.name)
        elif left := [i for i in range(field.shape[0]) if i not in taken[field.name]]:
            found.append(f"{field.name}[{', '.join(_label(field, i) for i in left)}]")
    return found


def _pairs(graph: Graph, wire: Link) -> list[tuple[str, str]]:
    """(far element, near element); none for a wire that is the identity."""
    fields = graph.layout.fields
    return [
        (f"{name}[{_label(fields[name], row)}]", f"{wire.name}[{mine}]")
        for (name, row), mine in zip(wire.rows or (), wire.near.names, strict=False)
    ]


def _label(field: Field, row: int) -> str:
    return field.labels[row] if field.labels else str(row)
