"""Builds the controllers of a profile and wires their inputs and outputs, element by element."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from srl.runtime.contracts.controller import OLD_NAMES
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.renamed import refuse_old_names
from srl.runtime.contracts.signals import Command, Kind, Signal
from srl.runtime.profile import transforms
from srl.runtime.profile.builder import Builder, form
from srl.runtime.profile.graph import Law
from srl.runtime.profile.names import Link, link
from srl.runtime.profile.profile import ControllerEntry
from srl.runtime.profile.transforms import in_frames
from srl.runtime.profile.wire import To

# What a controller may give beside a command: the rate of a position, the gravity compensation that a torque contains.
_COMPANIONS = {Kind.POSITION: "velocity", Kind.TORQUE: "gravity"}


class _Written:
    """Who writes each row of the commands and their companions."""

    def __init__(self, b: Builder) -> None:
        self._b = b
        self.rows: dict[str, dict[int, str]] = {}
        self.signals: dict[str, Signal] = {}

    def add(self, made: Link, targets: Mapping[str, Signal], place: str) -> None:
        """Notes the rows that an output writes; each may be written once."""
        for name, signal in targets.items():  # one that is listed and gets no row lacks all of them
            self.signals[name] = signal
            self.rows.setdefault(name, {})
        for name, row in made.rows or [(made.far[0], i) for i in range(_count(targets[made.far[0]]))]:
            writers = self.rows[name]
            if row in writers:
                raise WiringError(
                    self._b.source.place(place),
                    f"'{_element(targets[name], name, row)}' has two writers: {writers[row]} and {made.name}",
                    "Let only one of them write it",
                )
            writers[row] = made.name

    def missing(self, name: str) -> str:
        """The first element of a signal that nobody writes; "" if there is none."""
        signal, writers = self.signals[name], self.rows[name]
        return next((_element(signal, name, i) for i in range(_count(signal)) if i not in writers), "")


def _count(signal: Signal) -> int:
    return signal.shape[0] if signal.shape else 1


def _element(signal: Signal, name: str, row: int) -> str:
    return f"{name}[{signal.names[row] if signal.names else row}]"


def build(b: Builder, devices: list[Driver]) -> list[Law]:
    """Returns the controllers in their order. Raises ProfileError, WiringError."""
    commands = {f"{d.name}.{c.name}": c for d in devices for c in d.commands}
    written = _Written(b)
    made: list[Law] = []
    for i, entry in enumerate(b.profile.controllers):
        path = f"controllers.{i}"
        cls = b.source.load("controllers", entry.use, f"{path}.use")
        name = entry.called
        if name in b.layout.devices or name in b.profile.devices or any(w.controller.name == name for w in made):
            raise WiringError(b.source.place(path), f"the name '{name}' is taken", "Add `name:` to this controller")
        options = b.options(cls.Config, entry.options, path)
        law = Law(b.make(cls, name, options, what=f"controller '{entry.use}'", path=path))
        try:
            refuse_old_names(law.controller, OLD_NAMES)  # what its `__init__` sets, too
        except ImportError as error:
            raise WiringError(b.source.place(path), str(error), "Use a version of its package for this srl") from None
        made.append(law)
        for signal in (*law.controller.inputs, *law.controller.outputs):
            b.named(signal, f"{name}.{signal.name}", f"{path}.use")
        bound = _inputs(b, law, entry, path, written)
        _fed_as_calibrated(b, law, devices, path)
        law.transforms = transforms.find(b, law.controller, law.inputs, path)
        _outputs(b, law, entry, path, commands, written, bound)
    for name in commands:
        if name not in b.writers:
            raise WiringError(
                b.source.place("controllers"), f"no controller writes the command '{name}'",
                "Wire an output to it, or remove what makes the device take commands",
            )  # fmt: skip
    for name, writers in written.rows.items():
        if lacking := written.missing(name):
            raise WiringError(
                b.source.place("controllers"),
                f"no controller writes '{lacking}'; others of it: {', '.join(sorted(set(writers.values())))}",
                "Wire an output to each element",
            )
    for name, command in commands.items():
        b.add(f"{name}.applied", command, "applied", "the guard", "guard")
        b.add(f"{name}.sent", command, "sent", f"device '{name.partition('.')[0]}'", "guard")
    return made


def _inputs(b: Builder, law: Law, entry: ControllerEntry, path: str, written: _Written) -> dict[str, Signal]:
    """Wires the inputs; returns the first signal that each is bound to."""
    controller = law.controller
    wanted = {s.name: s for s in controller.inputs}
    bound: dict[str, Signal] = {}  # what each input has
    for name in entry.inputs:
        if name not in wanted:
            place = b.source.place(f"{path}.in.{name}")
            raise WiringError(place, f"{controller.name} has no input '{name}'", nearest(name, wanted))
    for name, signal in wanted.items():
        place = b.source.place(f"{path}.in.{name}")
        if name not in entry.inputs:
            raise WiringError(
                b.source.place(f"{path}.in"), f"input '{name}' ({form(signal)}) of {controller.name} isn't bound",
                f"Add `{name}: <device>.<signal>`; there are: {', '.join(sorted(b.signals)) or 'none'}",
            )  # fmt: skip
        wire = entry.inputs[name]
        for source in wire.signals:
            if source not in b.signals:
                raise WiringError(
                    place, f"no signal '{source}' is made before {controller.name}", nearest(source, b.signals)
                )
            if source.startswith("world."):
                raise WiringError(
                    place, f"'{source}' is the simulation's truth, which no real device could give",
                    "Wire a device's state instead",
                )  # fmt: skip
            if source in written.rows and (lacking := written.missing(source)):
                raise WiringError(
                    place, f"'{lacking}' isn't written before {controller.name}", "List this controller later"
                )
        far = {source: b.signals[source] for source in wire.signals}
        law.inputs[name] = link(in_frames(signal, bound), f"{controller.name}.{name}", far, wire.map, place)
        bound[name] = first = b.signals[wire.signals[0]]
        if first.of is None and (measured := b.measured_by(wire.signals[0])) is not None:
            bound[name] = replace(first, of=measured)
    return bound


def _fed_as_calibrated(b: Builder, law: Law, devices: list[Driver], path: str) -> None:
    """Raises WiringError: a device that feeds the law has other options than at the law's calibration."""
    for name, options in law.controller.fed_as.items():
        owners = {far.partition(".")[0]: far.partition(".")[2] for far in law.inputs[name].far}
        for device in (d for d in devices if d.name in owners):
            signals = getattr(device.config, "signals", None)  # of a device whose profile says its signals
            entry = signals.get(owners[device.name]) if isinstance(signals, Mapping) else device.config
            for key, was in options.items():
                now = getattr(entry, key, getattr(device.config, key, None))
                if now is not None and now != was:
                    problem = f"its calibration was made with {device.name}.{key} {was}, now it is {now}"
                    raise WiringError(b.source.place(f"{path}.in.{name}"), problem, "Set it as it was, or calibrate")


def _outputs(
    b: Builder, law: Law, entry: ControllerEntry, path: str, commands: dict[str, Command], written: _Written,
    bound: Mapping[str, Signal],
) -> None:  # fmt: skip
    controller = law.controller
    made = {s.name: in_frames(s, bound) for s in controller.outputs}
    for name in entry.outputs:
        if name not in made:
            place = b.source.place(f"{path}.out.{name}")
            raise WiringError(place, f"{controller.name} has no output '{name}'", nearest(name, made))
    for name, signal in made.items():
        full, place = f"{controller.name}.{name}", f"{path}.out.{name}"
        wire = entry.outputs.get(name) or To(signals=(full,))
        targets = {target: _target(b, target, commands, place) for target in wire.signals}
        if any(target is None for target in targets.values()):
            if len(targets) > 1 or wire.map:
                odd = next(t for t, found in targets.items() if found is None)
                raise WiringError(
                    b.source.place(place), f"'{odd}' isn't a command, so nothing is mapped onto it",
                    nearest(odd, commands),
                )  # fmt: skip
            b.add(wire.signals[0], signal, "internal", f"controller '{controller.name}'", place)
            law.outputs[name] = Link(signal, full, wire.signals)
            continue
        far = {target: found for target, found in targets.items() if found is not None}
        if 0 < len(far.keys() & commands.keys()) < len(far):
            raise WiringError(
                b.source.place(place), f"{', '.join(far)} are commands and what is beside them",
                "Give each an output of its own",
            )  # fmt: skip
        renamed = wire.map or _renamed_with_its_command(entry, signal, wire)
        found = law.outputs[name] = link(signal, full, far, renamed, b.source.place(place), "to")
        for target, there in far.items():
            if target not in b.writers:
                role = "command" if target in commands else "internal"
                b.add(target, there, role, f"controller '{controller.name}'", place)
        written.add(found, far, place)


def _target(b: Builder, target: str, commands: dict[str, Command], place: str) -> Signal | None:
    """The command, or the companion of one, that an output's target is; None for a signal of its own."""
    if target in commands:
        return commands[target]
    base, _, last = target.rpartition(".")
    if base in commands and last == _COMPANIONS.get(commands[base].kind):
        command = commands[base]
        unit = f"{command.unit}/s" if last == "velocity" else command.unit
        return Signal(
            name=last, shape=command.shape, unit=unit,
            labels=command.labels, slots=command.slots, components=command.components,
        )  # fmt: skip
    if target.split(".", maxsplit=1)[0] in b.profile.devices:
        companions = [f"{n}.{_COMPANIONS[c.kind]}" for n, c in commands.items() if c.kind in _COMPANIONS]
        remedy = nearest(target, [*commands, *companions])
        raise WiringError(b.source.place(place), f"'{target}' isn't a command of that device", remedy)
    return None


def _renamed_with_its_command(entry: ControllerEntry, signal: Signal, wire: To) -> Mapping[str, str]:
    """The map of the outputs whose rate or gravity part this one is: what is renamed there is renamed here."""
    bases = {target.rpartition(".")[0] for target in wire.signals}
    maps = [other.map for other in entry.outputs.values() if bases & set(other.signals)]
    return {own: there for renamed in maps for own, there in renamed.items() if own in signal.names}
