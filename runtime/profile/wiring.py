"""Builds, wires and checks the parts of a profile before anything is opened.

The checks: every input is bound to signals that are made earlier; elements are found by their names; shapes, units
and frames are equal; each element of a command has one writer; no option is unknown or unused. The result holds the
parts with views into one row, ready for the loop or a replay.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from srl.runtime.contracts import code_file, registry
from srl.runtime.contracts.controller import Parameter
from srl.runtime.contracts.driver import Driver, Sensor
from srl.runtime.contracts.errors import ProfileError, SrlError, WiringError, nearest
from srl.runtime.contracts.frames import Measured
from srl.runtime.contracts.renamed import refuse_old_names
from srl.runtime.contracts.signals import Array, Command, Kind, Signal, Stop
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST, POSITION_OF
from srl.runtime.contracts.world import World
from srl.runtime.ipc.row import Row
from srl.runtime.ipc.stop_slots import SLOTS
from srl.runtime.profile import (
    bus,
    buses,
    calibrated_frames,
    clearances,
    code_files,
    controllers,
    keys,
    measured_frames,
    switches,
)
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.declared import check_command, check_range
from srl.runtime.profile.graph import Actuator, Cleared, Copy, Graph, Law
from srl.runtime.profile.meta import describe
from srl.runtime.profile.names import Link, link
from srl.runtime.profile.pictured import pictured, with_a_place
from srl.runtime.profile.plausibility import warnings
from srl.runtime.profile.profile import SPANS, Profile
from srl.runtime.profile.robots import remarks as robot_remarks
from srl.runtime.profile.source import Source
from srl.runtime.profile.transforms import Found


def build(profile: Profile, source: Source, sim: Iterable[str] | None = None) -> Graph:
    """Builds and checks the whole system. Opens nothing.

    Args:
        profile: the profile from `srl.runtime.profile.profile.load`.
        source: its source, from the same function.
        sim: devices to simulate; empty for all; None for none.
    Raises:
        ProfileError, WiringError: with the key path and the remedy; for code in a file, with its line.
    """
    try:
        return _build(profile, source, sim)
    except SrlError:
        raise
    except Exception as error:
        if (fault := code_file.fault(error)) is None:
            raise
        raise fault from error


def _build(profile: Profile, source: Source, sim: Iterable[str] | None) -> Graph:
    b = Builder(profile, source, sim)
    _check_clock(b)
    world = _world(b)
    devices = _devices(b, world)
    _check_stops(b, devices)
    carried = buses.check(b, devices)
    owners = _setpoints(b)
    if world is not None:
        for signal in world.truth:
            b.add(f"world.{signal.name}", signal, "truth", "the simulated world", "sim")
    measured_frames.check_links(b, devices)
    measured_frames.check_signals(b, of={*b.profile.devices, *owners})
    calibrated_frames.as_measured(source, b.calibrated, b.signals)
    laws = controllers.build(b, devices)
    parameters = _parameters(b, laws)
    names = [d.name for d in devices] + owners
    b.layout.devices = names
    cleared = clearances.build(b, devices, laws, names)
    _unused(b, laws, devices, cleared)
    layout = b.layout
    scenery = world.scenery if world is not None else []
    robots, placed, unpictured = pictured(
        {name: entry.robot for name, entry in b.profile.devices.items()}, b.profile.models, b.profile.frames,
        source.files, b.signals, devices,
    )  # fmt: skip
    layout.meta = describe(b.profile, b.source, b.signals, b.simulated, devices, laws, parameters, scenery, b.frames)
    layout.meta["frames"] |= placed
    # A frame on a link that nothing measures isn't among those of the layout: the robot would stand at the root.
    layout.meta["robots"] = with_a_place(robots, layout.meta["frames"]) if profile.frames else robots
    keys.check(layout.fields, f"{b.source.label}: signal")
    row = Row(layout)
    for item in layout.meta["parameters"]:
        row.views[item["name"]][()] = item["default"]
    for entry in layout.meta["setpoints"]:
        row.views[entry["name"]][...] = np.nan  # none yet
    for item in layout.fields.values():
        if item.role == "sent":
            row.views[item.name][...] = np.nan  # nothing yet
    reads: list[Copy] = []
    fed = {name.partition(".")[0] for name in measured_frames.relied_on(laws)}
    graph = Graph(
        b.profile, source, layout, row, devices, laws, _actuators(b, devices, row, reads, cleared), world, b.frames,
        b.simulated, [_is_intent(name, devices, fed) for name in names],
        measured_frames.monitored_poses(b, laws, names, row),
        warnings(profile, source, devices, laws, world, b.simulated,
               {name: each.clearance for name, each in cleared.items()})
        + [f"{b.source.place(place)}: {text}" for place, text in unpictured]
        + calibrated_frames.warnings(source, b.calibrated, b.profile, b.simulated)
        + bus.warnings(profile.bus),
        [f"{b.source.place(f'sim.{key}')}: {text}" for key, text in (world.remarks if world is not None else ())]
        + carried
        + code_files.remarks(profile, source)
        + [f"{b.source.place(place)}: {text}" for place, text in robot_remarks(profile)],
        reads,
    )  # fmt: skip
    _bind(graph)
    return graph


def _check_clock(b: Builder) -> None:
    """The loop is paced by a device of the profile, or by none."""
    name, devices = b.profile.clock, b.profile.devices
    if name != "monotonic" and name not in devices:
        remedy = nearest(name, ["monotonic", *devices])
        raise ProfileError(b.source.place("clock"), f"there is no device '{name}'", remedy)


def _check_stops(b: Builder, devices: list[Driver]) -> None:
    """There is room for what stops each device that takes commands."""
    commanded = sum(bool(device.commands) for device in devices)
    if commanded > SLOTS:
        problem = f"{commanded} devices take commands, {SLOTS} at most can be stopped if the loop dies"
        raise WiringError(b.source.place("devices"), problem, "Split the profile into two instances")


def _world(b: Builder) -> World | None:
    if not b.simulated or b.profile.sim is None:
        return None
    cls = registry.load("worlds", b.profile.sim.world, b.source.place("sim.world"))
    try:
        world: World = cls(b.options(cls.Config, b.profile.sim.options, "sim"), b.profile.seed, b.frames)
        refuse_old_names(world, {"doubts": "warnings"})
    except ImportError as error:
        raise WiringError(b.source.place("sim"), str(error), "Use a version of its package for this srl") from None
    return world


def _devices(b: Builder, world: World | None) -> list[Driver]:
    devices: list[Driver] = []
    for name, entry in b.profile.devices.items():
        path = f"devices.{name}"
        if name in ("world", "bus"):
            raise ProfileError(b.source.place(path), f"the name '{name}' is taken by the runtime", "Choose another")
        cls = b.source.load("drivers", entry.driver, f"{path}.driver")
        config = b.options(cls.Config, entry.options, path)
        what = f"driver '{entry.driver}'"
        if name in b.simulated and world is not None and b.profile.sim is not None:
            fake = b.source.load("fakes", entry.driver, f"{path}.driver")
            options = b.options(fake.Options, b.profile.sim.devices.get(name, {}), f"sim.devices.{name}")
            devices.append(b.make(fake, name, config, world, options, what=f"the fake of {what}", path=path))
        else:
            devices.append(b.make(cls, name, config, what=what, path=path))
        device = devices[-1]
        if device.commands and type(device).write is Sensor.write:
            problem = f"driver '{entry.driver}' is a Sensor and declares commands, which nothing would send"
            raise WiringError(b.source.place(path), problem, "Derive it from Driver, with write and stop")
        for command in device.commands:
            check_command(command, b.source.place(path), entry.driver)
        for state in device.states:
            check_range(state, b.source.place(path), entry.driver)
        if device.commands and device.simulated and name not in b.simulated:
            problem = "it was made in simulation, and this device is real: what it moves would go elsewhere"
            raise ProfileError(b.source.place(f"{path}.{device.simulated}"), problem, "Calibrate the real one")
        if entry.max_age is not None:
            device.max_age = entry.max_age
        if device.states and not SPANS[0] <= device.max_age <= SPANS[1]:
            problem = f"driver '{entry.driver}' doesn't say when its samples are stale (max_age: {device.max_age})"
            raise WiringError(b.source.place(path), problem, "Nobody would notice its silence: give it a `max_age` (s)")
        for signal in device.states:
            b.add(f"{name}.{signal.name}", signal, "state", f"device '{name}'", path)
    if b.profile.sim is not None:
        for name in b.profile.sim.devices:
            if name not in b.profile.devices:
                place = b.source.place(f"sim.devices.{name}")
                raise ProfileError(place, f"there is no device '{name}'", nearest(name, b.profile.devices))
    for name in b.profile.stop:
        if name not in b.profile.devices:
            place = b.source.place(f"stop.{name}")
            raise ProfileError(place, f"there is no device '{name}'", nearest(name, b.profile.devices))
    return devices


def _setpoints(b: Builder) -> list[str]:
    owners: list[str] = []
    for name, entry in b.profile.setpoints.items():
        owner, _, short = name.partition(".")
        if owner in b.profile.devices:
            place = b.source.place(f"setpoints.{name}")
            raise ProfileError(place, f"'{owner}' is a device", "Give the client another name, such as 'client'")
        signal = Signal(
            name=short, shape=entry.shape, unit=entry.unit, frame=entry.frame,
            labels=entry.labels, slots=entry.slots, components=entry.components,
        )  # fmt: skip
        b.add(name, signal, "setpoint", "clients of the bus", f"setpoints.{name}")
        if owner not in owners:
            owners.append(owner)
    if owners and b.profile.bus is None:
        raise ProfileError(b.source.place("bus"), "`setpoints:` need the bus, which is off", "Remove `bus: null`")
    return owners


def _parameters(b: Builder, laws: list[Law]) -> list[tuple[str, Parameter]]:
    parameters = []
    for controller in (law.controller for law in laws):
        controller.narrow(1.0 / float(b.profile.rate))
        for p in controller.parameters:
            name = f"{controller.name}.{p.name}"
            b.add(name, Signal(name=p.name, shape=(), unit=p.unit), "parameter", "the parameters", "controllers")
            parameters.append((name, p))
    return parameters


def _unused(b: Builder, laws: list[Law], devices: list[Driver], cleared: dict[str, Cleared]) -> None:
    wired = measured_frames.relied_on(laws)
    wired |= {name for each in cleared.values() for wire in each.inputs.values() for name in wire.far}
    commands = {f"{d.name}.{c.name}": c for d in devices for c in d.commands}
    for name in b.profile.setpoints:
        if name not in wired:
            raise WiringError(b.source.place(f"setpoints.{name}"), f"nothing reads '{name}'", "Wire it or remove it")
    for name, entry in b.profile.guard.items():
        place = b.source.place(f"guard.{name}")
        if name not in commands:
            raise WiringError(place, f"no command is called '{name}'", nearest(name, commands))
        entry.check(commands[name], place)
    switches.check(b, devices)
    measured_frames.check_signals(b)


def _feedback(b: Builder, device: Driver, command: Command) -> Link | None:
    """What measures a command's elements; None for a device without feedback."""
    if command.feedback is None:
        return None
    place, name = f"devices.{device.name}", f"{device.name}.{command.feedback}"
    if name not in b.signals:
        raise WiringError(
            b.source.place(place), f"'{command.name}' names the feedback '{command.feedback}', which is no state of it",
            nearest(command.feedback, [s.name for s in device.states]),
        )  # fmt: skip
    return _beside(b, device, command, name)


def _beside(b: Builder, device: Driver, command: Command, name: str) -> Link:
    """The link from a command to a state of the same device that has an element for each of its own."""
    state, full = b.signals[name], f"{device.name}.{command.name}"
    # A planar twist is the rate of a planar pose, whose elements have other names.
    renamed = POSITION_OF if command.labels == PLANAR_TWIST and set(state.labels) == set(PLANAR) else {}
    place = b.source.place(f"devices.{device.name}")
    if state.shape != command.shape:
        raise WiringError(
            place, f"shapes differ: '{name}' has {list(state.shape)}, '{full}' has {list(command.shape)}",
            "A driver's feedback must measure each element of its command",
        )  # fmt: skip
    return link(replace(command, unit=state.unit, frame=state.frame), full, {name: state}, renamed, place)


def _actuators(
    b: Builder, devices: list[Driver], row: Row, reads: list[Copy], cleared: dict[str, Cleared]
) -> list[Actuator]:
    """The actuators; what must be copied for them before the guards run is added to `reads`."""
    actuators = []
    for i, device in enumerate(devices):
        category = b.profile.stop.get(device.name)
        for command in device.commands:
            name = f"{device.name}.{command.name}"
            if category is not None and category not in command.stops:
                raise WiringError(
                    b.source.place(f"stop.{device.name}"),
                    f"'{name}' ({command.kind}) can't do the stop category '{category}'",
                    f"It can: {', '.join(command.stops)}",
                )
            state, rate = _feedback(b, device, command), f"{device.name}.velocity"
            home = device.home.get(command.name)
            if home is not None and np.shape(home) != command.shape:
                problem = f"the home of '{name}' has shape {np.shape(home)}, the command {command.shape}"
                raise WiringError(b.source.place(f"devices.{device.name}"), problem, "Give each element its home")
            if command.kind is Kind.INTENSITY and command.stops != (Stop.OFF,):
                raise WiringError(
                    b.source.place(f"devices.{device.name}"),
                    f"its driver says that '{name}', which is what the wearer feels, stops by: "
                    f"{', '.join(command.stops)}",
                    "An intensity ends at once: give the driver's Command stops=(Stop.OFF,)",
                )
            if command.kind is Kind.INTENSITY and (command.feedback is not None or home is not None):
                problem = f"its driver says that '{name}', which is what the wearer feels, has a feedback or a home"
                raise WiringError(b.source.place(f"devices.{device.name}"), problem, "Give its Command neither")
            if state is None and home is None and command.kind is not Kind.INTENSITY:
                raise WiringError(
                    b.source.place(f"devices.{device.name}"),
                    f"'{name}' has no feedback, so the runtime can't know where it starts",
                    "Give the device a home position",
                )  # fmt: skip
            actuators.append(
                Actuator(
                    name,
                    i,
                    command,
                    row.views[name],
                    row.views.get(f"{name}.velocity"),
                    row.views.get(f"{name}.gravity"),
                    row.views[f"{name}.applied"],
                    row.views[f"{name}.sent"],
                    _array(row, state, reads) if state else None,
                    _array(row, _beside(b, device, command, rate), reads) if rate in b.signals else None,
                    category or command.stops[0],
                    home,
                    cleared.get(name),
                    row.views.get(f"{name}.{clearances.MARGIN}"),
                )
            )
    if b.profile.stop:
        driven = {devices[a.device].name for a in actuators}
        for name in b.profile.stop:
            if name not in driven:
                raise WiringError(
                    b.source.place(f"stop.{name}"), f"device '{name}' takes no commands", "Remove the line"
                )
    return actuators


def _is_intent(name: str, devices: list[Driver], fed: set[str]) -> bool:
    device = next((d for d in devices if d.name == name), None)
    if device is not None and device.commands:
        return False
    return name in fed


def _read_only(array: Array) -> Array:
    """A view that a driver can't change: the guard's state is in it."""
    view = array.view()
    view.flags.writeable = False
    return view


def _bind(graph: Graph) -> None:
    views = graph.row.views
    for device in graph.devices:
        device.bind(
            {s.name: views[f"{device.name}.{s.name}"] for s in device.states},
            {c.name: _read_only(views[f"{device.name}.{c.name}.applied"]) for c in device.commands},
        )
    for law in graph.laws:
        controller, row = law.controller, graph.row
        applied = {
            name: _array(row, wire.beside(".applied"), law.reads)
            for name, wire in law.outputs.items()
            if f"{wire.far[0]}.applied" in views
        }
        controller.bind(
            {name: _array(row, wire, law.reads) for name, wire in law.inputs.items()},
            {name: _array(row, wire, law.writes) for name, wire in law.outputs.items()},
            applied,
            {p.name: views[f"{controller.name}.{p.name}"] for p in controller.parameters},
            {found.need.name: _transform(graph, found, law) for found in law.transforms},
        )
    for cleared in graph.clearances.values():
        cleared.clearance.bind({name: _array(row, wire, cleared.copies) for name, wire in cleared.inputs.items()})
    if graph.world is not None:
        graph.world.bind({s.name: views[f"world.{s.name}"] for s in graph.world.truth})


def _transform(graph: Graph, found: Found, law: Law) -> Array:
    """A transform's pose (7,): its value, or what is computed each cycle."""
    if not found.signals:
        return np.array(found.pose)
    law.measured.append(Measured(graph.frames, found.path, graph.row.views))
    return law.measured[-1].pose


def _array(row: Row, wire: Link, copies: list[Copy]) -> Array:
    """A link's values: a view into the row, or an array of their own that is added to `copies`."""
    if wire.rows is None:
        return row.views[wire.far[0]]
    array = np.zeros(wire.near.shape)
    copies.append((wire.index(row.layout), array.reshape(-1)))
    return array
