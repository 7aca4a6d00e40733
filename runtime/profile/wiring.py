"""Builds, wires and checks the parts of a profile before anything is opened.

The checks: every input is bound to a signal that is made earlier; shapes, units and frames are equal; each
signal has one writer; no option is unknown or unused. The result holds the parts with views into one row,
ready for the loop or a replay.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from runtime.contracts import registry
from runtime.contracts.controller import Controller, Parameter
from runtime.contracts.driver import Driver, Sensor
from runtime.contracts.errors import ProfileError, WiringError, nearest
from runtime.contracts.signals import Array, Command, Kind, Signal
from runtime.contracts.world import World
from runtime.ipc.row import Row
from runtime.profile import keys
from runtime.profile.builder import Builder, text
from runtime.profile.graph import Actuator, Graph, form
from runtime.profile.meta import describe
from runtime.profile.profile import ControllerEntry, EmergencyInput, Profile, Source
from runtime.profile.reset import ResetInput

# What a controller may give beside a command: the rate of a position, the gravity compensation that a torque contains.
_COMPANIONS = {Kind.POSITION: "velocity", Kind.TORQUE: "gravity"}
LONGEST_PERIOD = 0.25  # s between commands; a slower device can't be told from a stalled link in time


def build(profile: Profile, source: Source, sim: Iterable[str] | None = None) -> Graph:
    """Builds and checks the whole system. Opens nothing.

    Args:
        profile: the profile from `runtime.profile.profile.load`.
        source: its source, from the same function.
        sim: devices to simulate; empty for all; None for none.
    Raises:
        ProfileError, WiringError: with the key path and the remedy.
    """
    b = Builder(profile, source, sim)
    world = _world(b)
    devices = _devices(b, world)
    owners = _setpoints(b)
    if world is not None:
        for signal in world.truth:
            b.add(f"world.{signal.name}", signal, "truth", "the simulated world", "sim")
    controllers, fed = _controllers(b, devices)
    parameters = _parameters(b, controllers)
    names = [d.name for d in devices] + owners
    b.layout.devices = names
    _unused(b, devices)
    layout = b.layout
    scenery = world.scenery if world is not None else []
    layout.meta = describe(b.profile, b.source, b.signals, b.simulated, devices, controllers, parameters, scenery)
    keys.check(layout.fields, f"{b.source.label}: signal")
    row = Row(layout)
    for item in layout.meta["parameters"]:
        row.views[item["name"]][()] = item["default"]
    for entry in layout.meta["setpoints"]:
        row.views[entry["name"]][...] = np.nan  # none yet
    for item in layout.fields.values():
        if item.role == "sent":
            row.views[item.name][...] = np.nan  # nothing yet
    graph = Graph(
        profile, source, layout, row, devices, controllers, _actuators(b, devices, row), world, b.frames,
        b.simulated, [_is_intent(name, devices, fed) for name in names],
    )  # fmt: skip
    _bind(graph)
    return graph


def _world(b: Builder) -> World | None:
    if not b.simulated or b.profile.sim is None:
        return None
    cls = registry.load("worlds", b.profile.sim.world, b.source.place("sim.world"))
    world: World = cls(b.options(cls.Config, b.profile.sim.options, "sim"), b.profile.seed)
    return world


def _devices(b: Builder, world: World | None) -> list[Driver]:
    devices: list[Driver] = []
    for name, entry in b.profile.devices.items():
        path = f"devices.{name}"
        if name in ("world", "bus"):
            raise ProfileError(b.source.place(path), f"the name '{name}' is taken by the runtime", "Choose another")
        cls = registry.load("drivers", entry.driver, b.source.place(f"{path}.driver"))
        config = b.options(cls.Config, entry.options, path)
        if name in b.simulated and world is not None and b.profile.sim is not None:
            fake = registry.load("fakes", entry.driver, b.source.place(f"{path}.driver"))
            options = b.options(fake.Options, b.profile.sim.devices.get(name, {}), f"sim.devices.{name}")
            devices.append(fake(name, config, world, options))
        else:
            devices.append(cls(name, config))
        device = devices[-1]
        if device.commands and type(device).write is Sensor.write:
            problem = f"driver '{entry.driver}' is a Sensor and declares commands, which nothing would send"
            raise WiringError(b.source.place(path), problem, "Derive it from Driver, with write and stop")
        for command in device.commands:
            _check_report(command, b.source.place(path), entry.driver)
        if entry.max_age is not None:
            device.max_age = entry.max_age
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


def _check_report(command: Command, place: str, driver: str) -> None:
    """Refuses a command whose driver doesn't say how it is sent: a stall couldn't be told from a slow device."""
    widths = np.ravel(command.resolution)
    if command.period is None or not 0 < command.period <= LONGEST_PERIOD:
        problem = f"driver '{driver}' doesn't declare how often it sends '{command.name}' (period: {command.period})"
    elif widths.size not in (1, command.size) or not (np.isfinite(widths) & (widths >= 0)).all():
        problem = f"driver '{driver}' declares no usable resolution of '{command.name}': {command.resolution}"
    else:
        return
    remedy = f"Give its Command a `period` of at most {LONGEST_PERIOD:g} s and a `resolution`, and fill `sent_arrays`"
    raise WiringError(place, problem, remedy)


def _setpoints(b: Builder) -> list[str]:
    owners: list[str] = []
    for name, entry in b.profile.setpoints.items():
        owner, _, short = name.partition(".")
        if owner in b.profile.devices:
            place = b.source.place(f"setpoints.{name}")
            raise ProfileError(place, f"'{owner}' is a device", "Give the client another name, such as 'client'")
        signal = Signal(name=short, shape=entry.shape, unit=entry.unit, frame=entry.frame)
        b.add(name, signal, "setpoint", "clients of the bus", f"setpoints.{name}")
        if owner not in owners:
            owners.append(owner)
    if owners and b.profile.bus is None:
        raise ProfileError(b.source.place("bus"), "`setpoints:` need the bus, which is off", "Remove `bus: null`")
    return owners


def _controllers(b: Builder, devices: list[Driver]) -> tuple[list[Controller], set[str]]:
    """The controllers in their order, and the names of all signals that feed one."""
    commands = {f"{d.name}.{c.name}": c for d in devices for c in d.commands}
    controllers: list[Controller] = []
    fed: set[str] = set()
    for i, entry in enumerate(b.profile.controllers):
        path = f"controllers.{i}"
        cls = registry.load("controllers", entry.use, b.source.place(f"{path}.use"))
        name = entry.name or entry.use
        if name in b.layout.devices or name in b.profile.devices or any(c.name == name for c in controllers):
            raise WiringError(b.source.place(path), f"the name '{name}' is taken", "Add `name:` to this controller")
        controller: Controller = cls(name, b.options(cls.Config, entry.options, path))
        controllers.append(controller)
        _inputs(b, controller, entry, path)
        fed |= set(entry.inputs.values())
        _outputs(b, controller, entry, path, commands)
    for name in commands:
        if name not in b.writers:
            raise WiringError(
                b.source.place("controllers"), f"no controller writes the command '{name}'",
                "Wire an output to it, or remove what makes the device take commands",
            )  # fmt: skip
    for name, command in commands.items():
        b.add(f"{name}.applied", command, "applied", "the guard", "guard")
        b.add(f"{name}.sent", command, "sent", f"device '{name.partition('.')[0]}'", "guard")
    return controllers, fed


def _inputs(b: Builder, controller: Controller, entry: ControllerEntry, path: str) -> None:
    wanted = {s.name: s for s in controller.inputs}
    for name in entry.inputs:
        if name not in wanted:
            place = b.source.place(f"{path}.in.{name}")
            raise WiringError(place, f"{controller.name} has no input '{name}'", nearest(name, wanted))
    for name, signal in wanted.items():
        place = f"{path}.in.{name}"
        if name not in entry.inputs:
            raise WiringError(
                b.source.place(f"{path}.in"), f"input '{name}' ({form(signal)}) of {controller.name} isn't bound",
                f"Add `{name}: <device>.<signal>`; there are: {', '.join(sorted(b.signals)) or 'none'}",
            )  # fmt: skip
        target = entry.inputs[name]
        if target not in b.signals:
            raise WiringError(
                b.source.place(place),
                f"no signal '{target}' is made before {controller.name}",
                nearest(target, b.signals),
            )
        if target.startswith("world."):
            raise WiringError(
                b.source.place(place), f"'{target}' is the simulation's truth, which no real device could give",
                "Wire a device's state instead",
            )  # fmt: skip
        b.match(place, b.signals[target], target, signal, f"{controller.name}.{name}")


def _outputs(
    b: Builder, controller: Controller, entry: ControllerEntry, path: str, commands: dict[str, Command]
) -> None:
    made = {s.name: s for s in controller.outputs}
    for name in entry.outputs:
        if name not in made:
            place = b.source.place(f"{path}.out.{name}")
            raise WiringError(place, f"{controller.name} has no output '{name}'", nearest(name, made))
    for name, signal in made.items():
        target = entry.outputs.get(name, f"{controller.name}.{name}")
        place = f"{path}.out.{name}"
        base, _, last = target.rpartition(".")
        writer = f"controller '{controller.name}'"
        if target in commands:
            b.match(place, signal, f"{controller.name}.{name}", commands[target], target)
            b.add(target, commands[target], "command", writer, place)
        elif base in commands and last == _COMPANIONS.get(commands[base].kind):
            command = commands[base]
            unit = f"{command.unit}/s" if last == "velocity" else command.unit
            companion = Signal(name=last, shape=command.shape, unit=unit, labels=command.labels)
            b.match(place, signal, f"{controller.name}.{name}", companion, target)
            b.add(target, companion, "internal", writer, place)
        elif target.split(".")[0] in b.profile.devices:
            companions = [f"{n}.{_COMPANIONS[c.kind]}" for n, c in commands.items() if c.kind in _COMPANIONS]
            remedy = nearest(target, [*commands, *companions])
            raise WiringError(b.source.place(place), f"'{target}' isn't a command of that device", remedy)
        else:
            b.add(target, signal, "internal", writer, place)


def _parameters(b: Builder, controllers: list[Controller]) -> list[tuple[str, Parameter]]:
    parameters = []
    for controller in controllers:
        for p in controller.parameters:
            name = f"{controller.name}.{p.name}"
            b.add(name, Signal(name=p.name, shape=(), unit=p.unit), "parameter", "the parameters", "controllers")
            parameters.append((name, p))
    return parameters


def _unused(b: Builder, devices: list[Driver]) -> None:
    wired = {target for c in b.profile.controllers for target in c.inputs.values()}
    commands = {f"{d.name}.{c.name}" for d in devices for c in d.commands}
    for name in b.profile.setpoints:
        if name not in wired:
            raise WiringError(b.source.place(f"setpoints.{name}"), f"nothing reads '{name}'", "Wire it or remove it")
    for name in b.profile.guard:
        if name not in commands:
            raise WiringError(
                b.source.place(f"guard.{name}"), f"no command is called '{name}'", nearest(name, commands)
            )
    for i, entry in enumerate(b.profile.emergency):
        _element(b, f"emergency.{i}", entry)
    _reset_inputs(b, devices)
    for name, frame in b.profile.frames.items():
        if frame.pose is not None:
            pose = b.signals.get(frame.pose)
            if pose is None or pose.shape != (7,):
                raise WiringError(
                    b.source.place(f"frames.{name}.pose"), f"'{frame.pose}' is no pose signal of shape 7",
                    nearest(frame.pose, [n for n, s in b.signals.items() if s.shape == (7,)]),
                )  # fmt: skip


def _element(b: Builder, path: str, entry: EmergencyInput | ResetInput) -> None:
    """Checks that the element of a signal that an input names is there."""
    signal = b.signals.get(entry.signal)
    if signal is None:
        remedy = nearest(entry.signal, b.signals)
        raise WiringError(b.source.place(path), f"no signal is called '{entry.signal}'", remedy)
    if entry.index >= signal.size:
        problem = f"'{entry.signal}' has {signal.size} elements, none at {entry.index}"
        raise WiringError(b.source.place(path), problem, "Indices start at 0")


def _reset_inputs(b: Builder, devices: list[Driver]) -> None:
    """A reset input is a button of a device: what a client or a law writes would release a person's stop."""
    states = {f"{d.name}.{s.name}" for d in devices for s in d.states}
    stops = {(e.signal, e.index) for e in b.profile.emergency}
    real = [d.name for d in devices if d.commands and d.name not in b.simulated]
    elsewhere = {d.name: "gives what another machine or a recording says" for d in devices if not d.here}
    if real:
        elsewhere |= {name: f"is simulated, and '{real[0]}' is real" for name in b.simulated}
    for i, entry in enumerate(b.profile.reset.inputs):
        path = f"reset.inputs.{i}"
        _element(b, path, entry)
        if entry.signal not in states:
            problem = f"'{entry.signal}' isn't the state of a device, and only a button of a device may reset"
            raise WiringError(b.source.place(path), problem, f"Name one of: {', '.join(sorted(states)) or 'none'}")
        if (entry.signal, entry.index) in stops:
            problem = f"'{entry.signal}' element {entry.index} is an emergency input, whose release must not reset"
            raise WiringError(b.source.place(path), problem, "Wire a button of its own")
        if why := elsewhere.get(entry.signal.partition(".")[0]):
            problem = f"'{entry.signal}' is no button that a person presses here: its device {why}"
            raise WiringError(b.source.place(path), problem, "Wire a button of this machine, or remove this input")


def _feedback(b: Builder, device: Driver, command: Command) -> str | None:
    """The signal that measures what a command moves; None for a device without feedback."""
    if command.feedback is None:
        return None
    place, name = f"devices.{device.name}", f"{device.name}.{command.feedback}"
    if name not in b.signals:
        raise WiringError(
            b.source.place(place), f"'{command.name}' names the feedback '{command.feedback}', which is no state of it",
            nearest(command.feedback, [s.name for s in device.states]),
        )  # fmt: skip
    if b.signals[name].shape != command.shape:
        problem = (
            f"shapes differ: '{name}' has {text(b.signals[name].shape)}, '{command.name}' has {text(command.shape)}"
        )
        raise WiringError(
            b.source.place(place), problem, "A driver's feedback must measure each element of its command"
        )
    return name


def _actuators(b: Builder, devices: list[Driver], row: Row) -> list[Actuator]:
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
            state = _feedback(b, device, command)
            if state is None and command.name not in device.home:
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
                    row.views[state] if state else None,
                    row.views.get(f"{device.name}.velocity"),
                    category or command.stops[0],
                    device.home.get(command.name),
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
    return any(target.split(".")[0] == name for target in fed)


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
    for controller, entry in zip(graph.controllers, graph.profile.controllers, strict=True):
        targets = {s.name: entry.outputs.get(s.name, f"{controller.name}.{s.name}") for s in controller.outputs}
        controller.bind(
            {s.name: views[entry.inputs[s.name]] for s in controller.inputs},
            {name: views[target] for name, target in targets.items()},
            {name: views[f"{target}.applied"] for name, target in targets.items() if f"{target}.applied" in views},
            {p.name: views[f"{controller.name}.{p.name}"] for p in controller.parameters},
        )
    if graph.world is not None:
        graph.world.bind({s.name: views[f"world.{s.name}"] for s in graph.world.truth})
    graph.frames.bind(views)
