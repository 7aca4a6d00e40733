"""Builds the clearances that a profile's `guard:` asks for, and wires their inputs as those of a controller."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from srl.runtime.contracts import registry
from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import OptionError, WiringError, nearest
from srl.runtime.contracts.per_element import in_order
from srl.runtime.contracts.signals import Command, Kind, Signal
from srl.runtime.profile import left_right
from srl.runtime.profile.builder import Builder, form
from srl.runtime.profile.graph import Cleared, Law
from srl.runtime.profile.guard_entry import ClearEntry
from srl.runtime.profile.names import Link, link

MARGIN = "margin"  # the signal beside a command that has a clearance


def build(b: Builder, devices: Iterable[Driver], laws: list[Law], owners: list[str]) -> dict[str, Cleared]:
    """Returns the clearances by command name.

    Args:
        b: all signals so far.
        devices: their drivers.
        laws: the controllers.
        owners: the devices and clients, in the layout's order.
    Raises:
        ProfileError, WiringError.
    """
    commands = {f"{d.name}.{c.name}": c for d in devices for c in d.commands}
    made = {}
    for name, entry in b.profile.guard.items():
        if entry.clear is not None and name in commands:
            cleared = made[name] = _cleared(b, name, entry.clear, commands[name])
            _alone(b, name, made)
            for own, wire in cleared.inputs.items():
                found = _behind(wire.far, laws, owners)
                if not found:
                    place = b.source.place(f"guard.{name}.clear.in.{own}")
                    problem = f"no device is behind {', '.join(wire.far)}, so nobody knows how old it is"
                    raise WiringError(place, problem, "Wire the state of a device")
                cleared.devices[own] = sorted(found)
            computed = {own for own, wire in cleared.inputs.items() if not _given(wire.far, owners)}
            cleared.computed = frozenset(computed)
            margin = Signal(name=MARGIN, shape=(1,), unit="m")
            b.add(f"{name}.{MARGIN}", margin, "internal", "the guard", f"guard.{name}.clear")
    left_right.compare(b, commands, laws, made)
    for name, cleared in made.items():
        cleared.clearance.meet([other.clearance for key, other in made.items() if key != name])
    return made


def _alone(b: Builder, name: str, made: Mapping[str, Cleared]) -> None:
    """Refuses a limb that another device's clearance judges: one of the two would be judged by the other's places."""
    limb, device = made[name].clearance.limb, name.partition(".")[0]
    for other, cleared in made.items():
        if limb is not None and other.partition(".")[0] != device and cleared.clearance.limb == limb:
            problem = f"'{other}' and '{name}' are said to be one and the same limb"
            raise WiringError(b.source.place(f"guard.{name}.clear"), problem, "Give each its own `side` or `arms`")


def _cleared(b: Builder, name: str, entry: ClearEntry, command: Command) -> Cleared:
    path = f"guard.{name}.clear"
    place = b.source.place(path)
    if command.kind in (Kind.TORQUE, Kind.INTENSITY):
        problem = f"a command of kind {command.kind} says nothing of how the limb brakes, so nothing can keep it clear"
        raise WiringError(place, problem, "Command the limb by position or velocity, or remove `clear:`")
    cls = registry.load("clearances", entry.use, b.source.place(f"{path}.use"))
    options = b.options(cls.Config, entry.options, path)
    clearance: Clearance = b.make(cls, place, options, command, what=f"clearance '{entry.use}'", path=path)
    if clearance.reach.shape != (command.size,) or not (np.isfinite(clearance.reach) & (clearance.reach > 0)).all():
        problem = f"clearance '{entry.use}' has the reach {clearance.reach}, the command {command.size} elements"
        raise WiringError(place, problem, "A reach above 0 m is needed for each element")
    try:
        tracking = in_order(entry.tracking, command.labels, size=command.size, ordered=command.ordered)
    except OptionError as error:
        raise WiringError(b.source.place(f"{path}.tracking"), error.problem, error.remedy) from None
    inputs = _inputs(b, clearance, entry, f"{name}.clear", path)
    timeout = _timeout(b, path, entry, command)
    if entry.least_lag > entry.lag:
        problem = f"no joint's lag is between {entry.least_lag:g} and {entry.lag:g} s"
        raise WiringError(b.source.place(f"{path}.least_lag"), problem, "It is the shortest lag, and `lag` the longest")
    values = np.array(tracking, np.float64)
    return Cleared(clearance, inputs, entry.lag, values, timeout, entry.least_lag, entry.period)


def _timeout(b: Builder, path: str, entry: ClearEntry, command: Command) -> float | None:
    """After how long a velocity ends by itself: the driver's word and the profile's, the longer of the two."""
    if command.kind is Kind.POSITION:
        if entry.timeout is not None:
            problem = "a position ends by itself where it was commanded"
            raise WiringError(b.source.place(f"{path}.timeout"), problem, "Remove `timeout`")
        return None
    timeouts = [each for each in (command.timeout, entry.timeout) if each is not None]
    if not timeouts:
        raise WiringError(
            b.source.place(path),
            "if the loop stalls, a velocity takes the limb on, and this device isn't known to end it by itself",
            "If it does, say after how long: add `timeout:` (s). Else command positions",
        )
    return max(timeouts)


def _inputs(b: Builder, clearance: Clearance, entry: ClearEntry, name: str, path: str) -> dict[str, Link]:
    wanted = {s.name: s for s in clearance.inputs}
    for given in entry.inputs:
        if given not in wanted:
            place = b.source.place(f"{path}.in.{given}")
            raise WiringError(place, f"{entry.use} has no input '{given}'", nearest(given, wanted))
    found = {}
    for own, signal in wanted.items():
        place = b.source.place(f"{path}.in.{own}")
        b.named(signal, f"{name}.{own}", f"{path}.use")
        if own not in entry.inputs:
            raise WiringError(
                b.source.place(f"{path}.in"), f"input '{own}' ({form(signal)}) of {entry.use} isn't bound",
                f"Add `{own}: <device>.<signal>`; there are: {', '.join(sorted(b.signals)) or 'none'}",
            )  # fmt: skip
        wire = entry.inputs[own]
        for source in wire.signals:
            if source not in b.signals:
                raise WiringError(place, f"no signal is called '{source}'", nearest(source, b.signals))
            if source.startswith("world."):
                raise WiringError(
                    place, f"'{source}' is the simulation's truth, which no real device could give",
                    "Wire a device's state instead",
                )  # fmt: skip
        far = {source: b.signals[source] for source in wire.signals}
        found[own] = link(signal, f"{name}.{own}", far, wire.map, place)
    return found


def _given(names: Iterable[str], owners: list[str]) -> bool:
    """Whether devices or clients give all of these signals themselves."""
    return all(name.partition(".")[0] in owners for name in names)


def _behind(names: Iterable[str], laws: list[Law], owners: list[str]) -> set[int]:
    """The indices of the devices and clients that signals come from, by way of laws or not."""
    by_name: Mapping[str, Law] = {law.controller.name: law for law in laws}
    found, left, known = set[int](), [name.partition(".")[0] for name in names], set[str]()
    while left:
        owner = left.pop()
        if owner in owners:
            found.add(owners.index(owner))
        elif owner in by_name and owner not in known:
            known.add(owner)
            law = by_name[owner]
            left += [name.partition(".")[0] for wire in law.inputs.values() for name in wire.far]
            left += [name.partition(".")[0] for each in law.transforms for name in each.signals]
    return found
