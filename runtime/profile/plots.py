"""The plots in a picture of a recording: one for each element of a command, and a profile's `record.plots`.

A line names a signal ("finger.position"), one element of it ("hand.tips[index]") or one number ("hand.tips[index,z]").
What has no names has indices.
"""

from __future__ import annotations

import re
from itertools import product
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, StringConstraints, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import RecordingError, nearest
from srl.runtime.contracts.field import Field as RowField
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.elements import elements

_REFERENCE = r"^([A-Za-z0-9_.\-]+)(?:\[([^,\[\]]+(?:,[^,\[\]]+)*)\])?$"
MEASURED, TRUTH = "measured", "simulated"
"""What a device says of itself, and what only the simulation knows of it; one word each."""
Reference = Annotated[str, StringConstraints(pattern=_REFERENCE)]


class Plot(BaseModel):
    """`record.plots[i]`: curves of one unit over time, or distances between points.

    For example `{title: Finger, unit: rad, lines: {measured: "world.finger"}}`, or
    `{title: Grip, unit: m, distance: {thumb: ["hand.tips[thumb]", "world.finger_tip"]}}`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str
    unit: str = Field(description="what the axis says; the values are not converted")
    lines: dict[str, Reference] = Field(default_factory=dict, description="by its label: a signal or a part of one")
    distance: dict[str, tuple[Reference, Reference]] = Field(
        default_factory=dict, description="by its label: two points (x, y, z), m, in the same frame"
    )

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.lines and not self.distance:
            raise ValueError("needs 'lines' or 'distance'")
        return self

    def curves(self, layout: Layout, rows: NDArray[np.int64]) -> dict[str, Array]:
        """The curves over rows (k, width), each (k,), by label. A larger signal gives one curve for each element.

        Raises:
            RecordingError: the layout lacks a signal, an index is out of range, or a point isn't (3,).
        """
        place = f"record.plots '{self.title}'"
        found: dict[str, Array] = {}
        for label, reference in self.lines.items():
            values = pick(layout, rows, reference, place)
            if values.ndim == 1:
                found[label] = values
            else:
                flat = values.reshape(len(rows), -1)
                names = element_names(layout, reference, flat.shape[1])
                found |= {f"{label} {name}": flat[:, i] for i, name in enumerate(names)}
        for label, (one, other) in self.distance.items():
            a, b = (pick(layout, rows, reference, place) for reference in (one, other))
            if a.shape[1:] != (3,) or b.shape[1:] != (3,):
                problem = f"'{one}' and '{other}' are shaped {a.shape[1:]} and {b.shape[1:]}, not (3,)"
                raise RecordingError(place, problem, "Name one point of each, as in hand.tips[thumb]")
            found[label] = np.linalg.norm(a - b, axis=1)
        return found


def command_plots(layout: Layout) -> list[Plot]:
    """Makes a plot for each element of each command: asked, applied, sent and, if available, where it is.

    A command `finger.position_command` is measured by the device's own `finger.position`. Of a device that measures
    nothing, the simulation knows the truth, `world.finger_position`: it is called so. Both have the command's shape and
    unit.
    """
    found = []
    for field in layout.fields.values():
        if field.role != "command":
            continue
        stem = field.name.removesuffix("_command")
        signals = {"asked": field.name, "applied": f"{field.name}.applied", "sent": f"{field.name}.sent"}
        for label, name in ((MEASURED, stem), (TRUTH, f"world.{stem.replace('.', '_')}")):
            other = layout.fields.get(name)
            if other is not None and (other.shape, other.unit) == (field.shape, field.unit):
                signals[label] = name
                break
        there = {label: name for label, name in signals.items() if name in layout.fields}
        names = zip(np.ndindex(field.shape), series_names(layout, field.name), elements(field), strict=True)
        for index, label, element in names:
            lines = {what: name + at for what, name in there.items() if (at := _at(layout.fields[name], field, index))}
            found.append(Plot(title=f"{stem} {label}", unit=element.unit, lines=lines))
    return found


def joint_plots(layout: Layout) -> list[Plot]:
    """Makes a plot for each command: each element as measured, else as the simulation knows it, else as applied.

    The title says which of these it is, if it isn't measured.
    """
    found: dict[tuple[str, str], dict[str, str]] = {}
    for plot in command_plots(layout):
        name = split(plot.lines["asked"])[0]
        label = plot.title.removeprefix(name.removesuffix("_command")).strip() or name
        what = next(each for each in (MEASURED, TRUTH, "applied", "asked") if each in plot.lines)
        found.setdefault((name, what), {})[label] = plot.lines[what]
    return [
        Plot(
            title=name.removesuffix("_command") + (f" ({what})" if what != MEASURED else ""),
            unit=layout.fields[name].unit, lines=lines,
        )
        for (name, what), lines in found.items()
    ]  # fmt: skip


def profile_plots(layout: Layout) -> list[Plot]:
    """The plots that the profile defines."""
    return [Plot(**p) for p in (layout.meta.get("record") or {}).get("plots", ())]


def split(reference: str) -> tuple[str, tuple[str, ...]]:
    """The signal's name of a reference, and the name or index along each axis."""
    match = re.match(_REFERENCE, reference)
    if match is None:
        raise RecordingError(f"'{reference}'", "it isn't a signal", "Write device.signal or device.signal[element]")
    return match[1], tuple(part.strip() for part in match[2].split(",")) if match[2] else ()


def indices(field: RowField | Signal, reference: str, place: str) -> tuple[int, ...]:
    """The index along each axis that a reference names. Raises RecordingError: there is no such element."""
    parts = split(reference)[1]
    axes = (field.labels, *field.components, *((),) * len(field.shape))
    if len(parts) > len(field.shape):
        raise RecordingError(place, f"'{reference}': '{field.name}' is shaped {field.shape}", "Name fewer axes")
    found = []
    for part, names, size in zip(parts, axes, field.shape, strict=False):
        if part not in names and not (part.isdecimal() and int(part) < size):
            problem = f"'{reference}': '{field.name}' has no '{part}', it is shaped {field.shape}"
            raise RecordingError(place, problem, nearest(part, names) if names else "Use indices from 0 within it")
        found.append(names.index(part) if part in names else int(part))
    return tuple(found)


def _at(field: RowField, command: RowField, index: tuple[int, ...]) -> str:
    """The part of a reference that names a command's element in `field`; "" where that has no such element."""
    if not index:
        return ""
    first = str(index[0])
    if field.labels and command.labels:
        if command.labels[index[0]] not in field.labels:
            return ""
        first = command.labels[index[0]]
    return f"[{','.join((first, *map(str, index[1:])))}]"


def pick(layout: Layout, rows: NDArray[np.int64], reference: str, place: str) -> Array:
    """The values of a reference over rows (k, width): (k, *rest of the shape), or (k,) for a rest of (1,)."""
    name = split(reference)[0]
    if name not in layout.fields:
        raise RecordingError(place, f"the recording has no signal '{name}'", nearest(name, layout.fields))
    values = layout.value(rows, name)
    for i in indices(layout.fields[name], reference, place):
        values = values[:, i]
    return values[:, 0] if values.shape[1:] == (1,) else values


def element_names(layout: Layout, reference: str, count: int) -> list[str]:
    """A name for each of the `count` elements that a reference covers."""
    name = split(reference)[0]
    names, index = series_names(layout, name), indices(layout.fields[name], reference, reference)
    shape = layout.fields[name].shape
    start = int(np.ravel_multi_index((*index, *(0,) * (len(shape) - len(index))), shape)) if shape else 0
    return names[start : start + count]


def series_names(layout: Layout, name: str) -> list[str]:
    """A name for each element of a signal, in the order of its words: "thumb x" for labels and points."""
    field = layout.fields[name]
    if not field.shape:
        return [name.rsplit(".", 1)[-1]]
    if field.visual == "sphere" and field.shape == (4,):
        return ["x", "y", "z", "radius"]
    first = list(field.labels) if len(field.labels) == field.shape[0] else [str(i) for i in range(field.shape[0])]
    if len(field.shape) == 1:
        return first
    inner = field.shape[1:]
    if field.components:
        return [" ".join(names) for names in product(first, *field.components)]
    last = list("xyz") if inner == (3,) else [",".join(map(str, i)) for i in np.ndindex(inner)]
    return [f"{a} {b}" for a in first for b in last]
