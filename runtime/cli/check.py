"""`srl check`: validates a profile and prints its wiring, or all of it. Opens nothing."""

from __future__ import annotations

import argparse
import datetime
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from srl.runtime.cli import add_command, calibrations, options, show
from srl.runtime.profile import code_files, library, profile, start_mode, wiring
from srl.runtime.profile.connections import connections, transforms, untaken
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.option_tree import files, listed
from srl.runtime.profile.schema import schema


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "check", "srl check sixth-finger")
    options.profile(parser, needed=False)
    options.sim(parser)
    options.overrides(parser)
    show.add_options(parser)
    parser.add_argument("--schema", action="store_true", help="print the JSON Schema of a profile, for editors")
    options.as_json(parser, "the wiring as one JSON object; with --all, all of it")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Checks the profile, prints the wiring and returns 0. Errors are raised."""
    if args.schema and args.profile is not None:
        from srl.runtime.contracts.errors import RequestError

        raise RequestError("--schema", "it is the same for every profile", "Leave the profile out")
    if args.schema:
        print(json.dumps(schema(), indent=1, allow_nan=False))  # an editor reads no Infinity
        return 0
    if args.profile is None:
        from srl.runtime.contracts.errors import ProfileError

        raise ProfileError("srl check", "no profile is named", f"One of: {', '.join(library.shipped())}")
    show.check(args)
    graph, guards = examine(args.profile, args.set, args.sim)
    written = show.write(args, graph)
    if args.json:
        found = show.content(graph) if args.only else content(graph, guards)
        print(json.dumps(found | {option: str(vars(args)[option]) for option in written}, allow_nan=False))
        return 0
    print("\n".join([*(show.lines(graph, args.only) if args.only else lines(graph, guards)), *written.values()]))
    return 0


def _read(graph: Graph) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """The files that a run would read, and the options that are lists, by their key paths."""
    judges = {name: cleared.clearance for name, cleared in graph.clearances.items()}
    built = graph.profile, graph.devices, graph.controllers, graph.world, judges
    return files(*built) | code_files.files(graph.profile, graph.source), listed(*built)


def content(graph: Graph, guards: dict[str, str]) -> dict[str, Any]:
    """What `--json` prints; `guards`: each command's stop category."""
    checked, source = graph.profile, graph.source
    read, listing = _read(graph)
    return {
        "profile": checked.name,
        "rate_hz": float(checked.rate),
        "chosen": source.chosen,
        "wiring": [asdict(connection) for connection in connections(graph)],
        "transforms": transforms(graph),
        "untaken": untaken(graph),
        "files": {path: {"path": str(f.path), "sha256": f.sha256} for path, f in read.items()},
        "warnings": [*graph.warnings, *calibrations.warnings(source.files.kept, datetime.date.today())],
        "remarks": graph.remarks,
        "commands": guards,
        "clearances": {name: cleared.clearance.remarks() for name, cleared in graph.clearances.items()},
        "listed_options": listing,
        "listed_limits": {name: listed_limits(graph, name) for name in guards},
    }


def lines(graph: Graph, guards: dict[str, str]) -> Iterator[str]:
    """The text; `guards`: each command's stop category."""
    checked, source = graph.profile, graph.source
    read, listing = _read(graph)
    yield f"{checked.name}: {checked.summary}".rstrip(": ")
    yield f"  rate {float(checked.rate):g} Hz, clock {checked.clock}, start {start_mode.start(graph)}"
    for choice, word in source.chosen.items():
        yield f"  choice {choice}: {word}"
    for device in graph.devices:
        kind = "simulated" if device.name in graph.simulated else checked.devices[device.name].driver
        age = f", stale after {device.max_age:g} s" if device.max_age else ""
        yield f"  device {device.name} ({kind}{age})"
    for c in connections(graph):
        yield f"  {c.start:<34} -> {c.end:<34} {c.form}" + ", by name" * bool(c.elements)
        for start, end in c.elements:
            yield f"    {start:<32} -> {end}"
    for t in transforms(graph):
        place = ", ".join(f"{v:g}" for v in t["position"]), ", ".join(f"{v:.6g}" for v in t["quaternion"])
        by = f", measured by {', '.join(t['measured_by'])}" if t["measured_by"] else ""
        yield f"  {t['name']:<34} {t['of']} in {t['into']}, from {t['from']}{by}"
        yield f"    position {place[0]} m, quaternion {place[1]}" + " while what is measured is zero" * bool(by)
    for path, values in listing.items():
        yield f"  option {path}: {_pairs(values)}"
    for path, file in read.items():
        yield f"  file {path}: {file.path}, sha256 {file.sha256}"
    for warning in (*graph.warnings, *calibrations.warnings(source.files.kept, datetime.date.today())):
        yield f"  warning: {warning}"
    for remark in graph.remarks:
        yield f"  {remark}"
    if left := untaken(graph):
        yield f"  nothing takes {', '.join(left)}"
    for name, category in guards.items():
        yield f"  guard {name}, stop: {category}"
        for limit, values in listed_limits(graph, name).items():
            yield f"    {limit}: {_pairs(values)}"
        for remark in graph.clearances[name].clearance.remarks() if name in graph.clearances else ():
            yield f"    {remark}"


def _pairs(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in values.items())


def examine(name: str, overrides: Sequence[str] = (), sim: list[str] | None = None) -> tuple[Graph, dict[str, str]]:
    """Checks a profile. Returns its wiring, and each command's stop category.

    Args:
        name: of a shipped profile, or a file's path.
        overrides: the `--set` options.
        sim: the devices that are simulated; none: all; None: nothing is.
    Raises:
        SrlError: what is wrong first.
    """
    checked, source = profile.load(name, overrides)
    graph = wiring.build(checked, source, sim)
    guards = check_guards(graph)
    check_certificates(graph)
    return graph, guards


def check_guards(graph: Graph) -> dict[str, str]:
    """Builds the guards from what is known before a device is open. Returns each command's stop category.

    What a device then gives as its own narrows a limit, and takes the place of none.
    """
    from srl.runtime.loop.guards import limits_of, unbound

    categories, limits = {}, limits_of(graph)
    for actuator in graph.actuators:
        guard = unbound(graph, actuator, limits[actuator.name])
        if actuator.cleared is not None:
            guard.check_stroke(actuator.cleared.clearance, known=False)
        categories[actuator.name] = str(actuator.category)
    return categories


def check_certificates(graph: Graph) -> None:
    """Reads the certificates of the bus and of real devices, which belong to this host and not to the profile.

    Raises:
        ProfileError: one is missing, can't be read, or doesn't fit.
    """
    given = [("bus.tls", graph.profile.bus.tls if graph.profile.bus is not None else None)]
    real = [device for device in graph.devices if device.name not in graph.simulated]
    given += [(f"devices.{device.name}.tls", getattr(device.config, "tls", None)) for device in real]
    for path, tls in given:
        if tls is not None:
            tls.check(graph.source.place(path))
    bus = graph.profile.bus
    if bus is not None and bus.tls is not None and bus.ros2 is not None and bus.ros2.router.startswith("tls/"):
        bus.tls.check_client(graph.source.place("bus.tls"))


def listed_limits(graph: Graph, command: str) -> dict[str, dict[str, float]]:
    """The limits of a command that the profile gives as lists: by limit, the value of each joint."""
    (labels,) = (a.command.labels for a in graph.actuators if a.name == command)
    given = vars(graph.profile.guard[command]) if command in graph.profile.guard else {}
    return {k: dict(zip(labels, v, strict=False)) for k, v in given.items() if isinstance(v, list) and len(v) > 1}
