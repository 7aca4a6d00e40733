"""The part of a profile that a calibration needs: the sensors and laws before the law that it is for.

Nothing moves: the law itself, what stands behind it, every actuator, guard and stop are left out. So it works, too,
when the calibration file that the profile names isn't there yet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from math import inf
from typing import Any, Final

from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.errors import ProfileError, WiringError, nearest
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.part import frames_left, parsed
from srl.runtime.profile.profile import ControllerEntry, Profile
from srl.runtime.profile.source import Source

LAW: Final = "ikns"
ANGLES: Final = "arm-angles"
MARKS: Final = "calibration-marks"
Marks = Callable[[Graph, ControllerEntry], dict[str, Any]]
Scene = Callable[[dict[str, Any]], None]
_DROPPED: Final = ("setpoints", "guard", "stop", "faults", "emergency", "reset", "record", "start")


def find(checked: Profile, source: Source, use: str = LAW) -> int:
    """The place of the law to calibrate among the profile's controllers. Raises ProfileError: not exactly one."""
    found = [i for i, entry in enumerate(checked.controllers) if entry.use == use]
    if len(found) != 1:
        problem = f"the profile has {len(found)} laws '{use}'" if found else f"the profile has no law '{use}'"
        remedy = "Calibrate with a profile that has one" if found else f"Add `- use: {use}` to it (docs/calibrate.md)"
        raise ProfileError(source.place("controllers"), problem, remedy)
    return found[0]


def subset(
    checked: Profile,
    source: Source,
    person: str,
    dofs: tuple[str, ...],
    thresholds: Thresholds,
    sim: bool = False,
) -> tuple[Profile, Source]:
    """Returns the profile that is cut for `ikns`, with the marks' law at its end; as in `subset_for`.

    Args:
        checked, source: the whole profile.
        person: anonymous id.
        dofs: names of the degrees of freedom to calibrate.
        thresholds: of the calibration.
        sim: keep the names of the simulated world's parts, on which frames may hang.
    """
    return subset_for(checked, source, LAW, ("angles", "hand"), partial(_marks, person, dofs, thresholds), sim)


def subset_for(
    checked: Profile, source: Source, use: str, reads: Sequence[str], marks: Marks, sim: bool,
    only: Sequence[str] | None = None, scene: Scene | None = None,
) -> tuple[Profile, Source]:  # fmt: skip
    """Returns the cut profile, with the marks' law at its end.

    Args:
        checked, source: the whole profile.
        use: the law that is calibrated.
        reads: its inputs that must be bound.
        only: of its inputs, the ones whose devices and laws are kept; None: all.
        marks: makes the entry of the marks' law.
        sim: keep the names of the simulated world's parts, on which frames may hang.
        scene: changes what is left of the profile: devices, frames, the simulated world.
    Raises:
        ProfileError, WiringError: there is no such law, or what it reads can't be had without moving something.
    """
    law = find(checked, source, use)
    entry = checked.controllers[law]
    for name in reads:
        if name not in entry.inputs:
            raise WiringError(
                source.place(f"controllers.{law}.in"), f"input '{name}' isn't bound", f"Add `{name}: SOURCE.{name}`"
            )
    kept, devices = _needed(checked, source, law, only)
    _still(checked, source, kept, devices)
    return subset_of_devices(checked, source, devices, lambda before: marks(before, entry), sim, scene, kept)


def subset_of_devices(
    checked: Profile, source: Source, devices: set[str], marks: Callable[[Graph], dict[str, Any]], sim: bool,
    scene: Scene | None = None, kept: Sequence[int] = (),
) -> tuple[Profile, Source]:  # fmt: skip
    """Returns the profile with these devices and laws alone, and the marks' law at its end; as in `subset_for`.

    Args:
        devices: that are kept. Raises WiringError: one of them takes commands.
        kept: the places of the laws that are kept.
    """
    kept = list(kept)
    plain, _ = profile.tree(source.label, source.text, source.overrides, source.files)
    for key in _DROPPED:
        plain.pop(key, None)
    plain["devices"] = {name: plain["devices"][name] for name in plain["devices"] if name in devices}
    plain["bus"] = None
    if plain.get("clock") not in devices:
        plain.pop("clock", None)
    laws = [checked.controllers[i] for i in kept]
    plain["frames"] = frames_left(checked, plain.get("frames") or {}, devices, laws, sim)
    plain["controllers"] = [plain["controllers"][i] for i in kept]
    for each in plain["controllers"]:
        if each["use"] == ANGLES:  # nothing moves, so whoever leaves the cameras' view needs no reset
            each["max_hold"] = inf
    if plain.get("sim"):
        plain["sim"]["devices"] = {n: v for n, v in (plain["sim"].get("devices") or {}).items() if n in devices}
        for key in ("ends_with", "duration"):
            plain["sim"].pop(key, None)
    if scene is not None:
        scene(plain)
    before = _build(plain, source, kept, sim)
    plain["controllers"].append(marks(before))
    return parsed(plain, source, kept)


def build(checked: Profile, source: Source, sim: bool) -> Graph:
    """Builds the system of a cut profile, simulated or not. Opens nothing."""
    return wiring.build(checked, source, [] if sim else None)


def _needed(checked: Profile, source: Source, law: int, only: Sequence[str] | None) -> tuple[list[int], set[str]]:
    """The laws before `law` that it needs for its inputs, directly or not, in their order; and the devices."""
    writers: dict[str, int] = {}
    for i, entry in enumerate(checked.controllers):
        for wire in entry.outputs.values():
            writers |= dict.fromkeys(wire.signals, i)
    names = {entry.called: i for i, entry in enumerate(checked.controllers)}
    measured = {f.pose for f in checked.frames.values() if f.pose is not None}
    laws: set[int] = set()
    devices: set[str] = set()
    open_ = [(law, name) for name in _read(checked.controllers[law], only)]
    while open_:
        reader, name = open_.pop()
        owner = name.partition(".")[0]
        place = source.place(f"controllers.{reader}.in")
        if owner in checked.devices:
            devices.add(owner)
        elif name in checked.setpoints:
            problem = f"'{name}' comes from clients of the bus, and there is no bus during a calibration"
            raise WiringError(place, problem, "Wire what a device gives")
        elif (writer := writers.get(name, names.get(owner))) is not None and writer < reader:
            if writer not in laws:
                laws.add(writer)
                open_ += [(writer, each) for each in _read(checked.controllers[writer])]
        else:
            raise WiringError(place, f"no signal '{name}' is made before", nearest(name, [*names, *checked.devices]))
    # A law may need a frame that a device measures and nothing else reads.
    devices |= {
        owner for pose in measured if (owner := pose.partition(".")[0]) in checked.devices and _quiet(checked, owner)
    }
    return sorted(laws), devices


def _still(checked: Profile, source: Source, kept: list[int], devices: set[str]) -> None:
    """Raises WiringError: a law that is kept commands something, or a device that is kept takes commands."""
    for i, entry in enumerate(checked.controllers):
        for name, wire in entry.outputs.items():
            for target in wire.signals:
                owner = target.partition(".")[0]
                if i in kept and owner in checked.devices:
                    problem = f"a law that gives the angles or the hand also commands '{target}'"
                    remedy = "Split it in two laws, one that measures and one that commands: nothing may move meanwhile"
                    raise WiringError(source.place(f"controllers.{i}.out.{name}"), problem, remedy)
                if owner in devices:
                    problem = f"angles or hand come from it, and it takes commands ('{target}'), so it could move"
                    remedy = "Take them from devices that only measure"
                    raise WiringError(source.place(f"devices.{owner}"), problem, remedy)


def _quiet(checked: Profile, device: str) -> bool:
    """Whether the profile commands nothing of a device."""
    return not any(
        target.partition(".")[0] == device
        for e in checked.controllers
        for w in e.outputs.values()
        for target in w.signals
    )


def _read(entry: ControllerEntry, only: Sequence[str] | None = None) -> Iterator[str]:
    for name, wire in entry.inputs.items():
        if only is None or name in only:
            yield from wire.signals


def _build(plain: dict[str, Any], source: Source, kept: list[int], sim: bool) -> Graph:
    """The system before the marks are there, for the names of its signals' elements. Raises WiringError: it can move.

    The loop keeps an active actuator where it is even if no law commands it. Guard and stop are left out, so there
    must be none.
    """
    graph = build(*parsed(plain, source, kept), sim)
    if graph.actuators:
        problem = f"it would still command '{graph.actuators[0].name}' during the calibration"
        raise WiringError(source.label, problem, "Take the angles and the hand from devices that only measure")
    return graph


def elements(graph: Graph, use: str, entry: ControllerEntry, port: str) -> dict[str, str]:
    """Where each element of a law's input is, by the law's own name for it: {"right_elbow": "arm.angles[elbow]"}.

    Raises WiringError: a signal isn't there, or two have an element of this name.
    """
    place, fields = f"the input '{port}' of {use}", graph.layout.fields
    wire = entry.inputs[port]
    own = {far: near for near, far in wire.map.items()}
    found: dict[str, str] = {}
    for signal in wire.signals:
        if signal not in fields:
            raise WiringError(place, f"there is no signal '{signal}'", nearest(signal, fields))
        for label in fields[signal].labels or ("0",):
            name = own.get(f"{signal}.{label}", own.get(label, label))
            if name in found:
                raise WiringError(place, f"two signals have a joint '{name}'", "Rename one with `map:`")
            found[name] = f"{signal}[{label}]"
    return found


def _marks(
    person: str, dofs: tuple[str, ...], thresholds: Thresholds, graph: Graph, entry: ControllerEntry
) -> dict[str, Any]:
    """The entry of the marks' law: where each joint's angle is, whether it is observed, and where the hand is."""
    angles = elements(graph, LAW, entry, "angles")
    held = elements(graph, LAW, entry, "held") if "held" in entry.inputs else {}
    (hand,) = entry.inputs["hand"].signals
    return {
        "use": MARKS, "name": MARKS, "person": person, "dofs": list(dofs), "angles": angles,
        "held": {joint: where for joint, where in held.items() if joint in angles},
        "hand": hand, "thresholds": thresholds.model_dump(),
    }  # fmt: skip
