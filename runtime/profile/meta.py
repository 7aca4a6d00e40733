"""The metadata that a reader of rows needs: where the rows come from and which requests the run accepts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from srl.runtime.contracts import provenance
from srl.runtime.contracts.controller import Parameter
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import RecordingError, WiringError, nearest
from srl.runtime.contracts.files import encoded
from srl.runtime.contracts.frames import FrameEntry, Frames
from srl.runtime.contracts.rotation import inverted
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POSE
from srl.runtime.contracts.world import Fake
from srl.runtime.profile.graph import Law
from srl.runtime.profile.names import Link
from srl.runtime.profile.plots import indices, split
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


def describe(
    profile: Profile,
    source: Source,
    signals: Mapping[str, Signal],
    simulated: list[str],
    devices: list[Driver],
    laws: list[Law],
    parameters: list[tuple[str, Parameter]],
    scenery: list[dict[str, Any]],
    frames: Frames,
) -> dict[str, Any]:
    """Returns the layout's `meta`, which holds JSON types only."""
    return {
        "name": profile.name,
        "label": source.label,
        "profile": source.text,
        "overrides": list(source.overrides),
        "chosen": dict(source.chosen),
        "sha256": source.sha256,
        "files": encoded(source.files.kept),
        "rate": [profile.rate.numerator, profile.rate.denominator],
        "seed": profile.seed,
        "simulated": simulated,
        "versions": provenance.versions(),
        "blas": provenance.blas(),
        "wall": time.time_ns() - time.monotonic_ns(),
        "devices": {
            d.name: {"driver": profile.devices[d.name].driver, "max_age": d.max_age, "simulated": isinstance(d, Fake)}
            for d in devices
        },
        "commands": {f"{d.name}.{c.name}": {"kind": c.kind.value} for d in devices for c in d.commands},
        "controllers": [
            {"name": law.controller.name, "use": e.use} for law, e in zip(laws, profile.controllers, strict=True)
        ],
        "parameters": [
            {"name": n, "lower": p.lower, "upper": p.upper, "unit": p.unit, "text": p.text, "default": p.default}
            for n, p in parameters
        ],
        "emergency": [f"{e.signal}[{e.find(signals, '')}]" for e in profile.emergency],
        "setpoints": [
            {"name": n, "max_age": e.max_age, "moves": _moves(n, laws, devices, signals)}
            for n, e in profile.setpoints.items()
        ],
        "frames": {n: f.model_dump() for n, f in _seen(frames, signals).items()},
        "scenery": scenery,
        "bus": profile.bus.model_dump() if profile.bus is not None else None,
        "record": {"plots": _plots(profile, source, signals, simulated)}
        | ({} if profile.record.keep is None else {"keep": profile.record.keep.model_dump()}),
    }


def _moves(
    setpoint: str, laws: list[Law], devices: list[Driver], signals: Mapping[str, Signal]
) -> str | None:  # fmt: skip
    """The command of the one device to which a setpoint is passed on as it is, joint by joint; None: there is none."""

    def as_it_is(link: Link, name: str) -> bool:
        rows = link.rows or ()
        near = zip(link.near.labels, rows, strict=False)
        return link.far == (name,) and all(label == signals[far].labels[row] for label, (far, row) in near)

    readers = [(law, name, link) for law in laws for name, link in law.inputs.items() if setpoint in link.far]
    if len(readers) != 1:
        return None
    law, name, link = readers[0]
    given = law.outputs.get(law.controller.passes.get(name, ""))
    for command in [f"{d.name}.{c.name}" for d in devices for c in d.commands]:
        if given is not None and as_it_is(link, setpoint) and as_it_is(given, command):
            return command
    return None


def _seen(frames: Frames, signals: Mapping[str, Signal]) -> dict[str, FrameEntry]:
    """The frames as a viewer can place them: what hangs on a link follows the frame of it whose pose a signal gives."""
    seen = dict(frames.entries)
    links = {root for name in frames.entries if "/" in (root := frames.chain(name)[-1])}
    for link in sorted(links):
        hanging = {n for n in frames.entries if frames.chain(n)[-1] == link}
        # The truth of a simulated world is in the world, whatever its frame is called.
        poses = {n: s for n, s in signals.items() if s.of in hanging and s.labels == POSE}
        found = next(((n, s) for n, s in poses.items() if s.frame or n.startswith("world.")), None)
        if found is None:
            for name in hanging:
                del seen[name]
            continue
        name, signal = found
        above = FrameEntry(parent=signal.frame, pose=name)
        for frame in frames.chain(str(signal.of)):  # up to the link, each hangs on the one before
            entry = seen.get(frame)
            seen[frame] = above
            if entry is not None:
                x, y, z, *turn = inverted(entry.placed())
                above = FrameEntry(parent=frame, position=(x, y, z), quaternion=(turn[0], turn[1], turn[2], turn[3]))
    return seen


def _plots(
    profile: Profile, source: Source, signals: Mapping[str, Signal], simulated: list[str]
) -> list[dict[str, Any]]:
    """Returns the profile's plots. Without a simulated world, curves of its signals are left out."""
    kept = []
    for i, plot in enumerate(profile.record.plots):
        missing = set()
        for references in [*((r,) for r in plot.lines.values()), *plot.distance.values()]:
            for name, reference in ((split(reference)[0], reference) for reference in references):
                if signal := signals.get(name) or signals.get(name.removesuffix(".applied").removesuffix(".sent")):
                    _check_element(signal, reference, source.place(f"record.plots.{i}"))
                    continue
                if not name.startswith("world.") or simulated:
                    place = source.place(f"record.plots.{i}")
                    raise WiringError(place, f"no signal is called '{name}'", nearest(name, signals))
                missing.add(name)
        lines = {label: r for label, r in plot.lines.items() if split(r)[0] not in missing}
        distance = {label: pair for label, pair in plot.distance.items() if not missing & {split(r)[0] for r in pair}}
        if lines or distance:
            kept.append(plot.model_copy(update={"lines": lines, "distance": distance}).model_dump())
    return kept


def _check_element(signal: Signal, reference: str, place: str) -> None:
    """Refuses a reference to an element that isn't there, or by its place where it has a name."""
    parts = split(reference)[1]
    try:
        indices(signal, reference, place)
    except RecordingError as error:
        raise WiringError(error.place, error.problem, error.remedy) from None
    for part, names in zip(parts, (signal.labels, *signal.components), strict=False):
        if names and part not in names:
            problem = f"'{reference}': the elements of '{signal.name}' have names, and {part} is a place"
            raise WiringError(place, problem, f"Write one of: {', '.join(names)}")
