"""Warnings: numbers and wiring that are probably wrong, but not refused.

Numbers in another unit: degrees for radians, millimetres for metres, grams for kilograms, milliseconds for
seconds. A number's unit is the first word of its option's description; a hall may be longer than a room. Where a real
device is to move, such a number is refused, unless the profile's `meant:` names it.

A file of the simulated wearer where real devices feed the law, and one of another body than the profile's.

What the simulated world says of its options, such as a recording that doesn't fit its hand.

Two devices at one port of this machine.

What can't be right in a robot's URDF, and bounds of the guard beyond the URDF's (`srl.runtime.profile.robots`).

What a law says of its options at the profile's rate.

A worn arm that nothing keeps clear of its wearer, though a suit says where the wearer is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import hypot, inf, isfinite, pi, radians
from typing import Any, Final

from pydantic.fields import FieldInfo

from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.options import old_keys
from srl.runtime.contracts.signals import Command
from srl.runtime.contracts.world import World
from srl.runtime.models.models import ArmsModel, bodies
from srl.runtime.profile import robots
from srl.runtime.profile.graph import Graph, Law
from srl.runtime.profile.option_tree import items, options
from srl.runtime.profile.ports import shared
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

TURN: Final = 2 * pi + 1e-3  # rad; a joint's range may be a turn both ways
ROOM: Final = 20.0  # m
REACH: Final = 3.0  # m, of what is on a limb: a tool, a centre of mass
NEAR: Final = 1.0  # m, by which a mount may be off
FAST: Final = {"rad": 25.0, "m": 10.0}  # a second; servos turn by 10 rad/s, and a base's speeds are in both
FAR: Final = 1.0  # rad or m: a limb that is further from its command follows nothing
PERSON: Final = 150.0  # kg
OLD: Final = 5.0  # s; by what is older nobody guides a limb
_UNIT: Final = re.compile(r"(rad|m|kg)(?![\w/^*]| m\b)(?! (?:and|s)\b)")


def warnings(
    profile: Profile,
    source: Source,
    devices: list[Driver],
    laws: list[Law],
    world: World | None,
    simulated: list[str],
    clearances: Mapping[str, Clearance],
) -> list[str]:
    """Returns the warnings, a line each, with its place; `simulated` names devices.

    Raises:
        WiringError: a real device is to move, and a number can't be in its unit.
    """
    units = [
        warning
        for path, field, value in options(profile, devices, [law.controller for law in laws], world, clearances)
        for warning in _of_option(path, field, value)
    ]
    commands = {f"{d.name}.{c.name}": c for d in devices for c in d.commands}
    for name, limits in profile.guard.items():
        unit = _position_unit(commands.get(name))
        for key in ("lower", "upper"):
            for place, value in _numbers(getattr(limits, key, None), f"guard.{name}.{key}"):
                units += _doubt(place, value, unit)
        unit = "m" if unit == "m/s, rad/s" else unit
        for place, value in _numbers(limits.velocity, f"guard.{name}.velocity"):
            if unit in FAST and FAST[unit] < abs(value) < inf:
                what, meant = ("degrees", radians(value)) if unit == "rad" else ("millimetres", value / 1000)
                asked = f"Are these {what}? {value:g} {what} a second are {meant:.4g} {unit}/s"
                units.append((place, f"{value:g} {unit}/s is faster than any limb. {asked}"))
        window = getattr(limits.following_error, "window", None)
        for place, value in _numbers(window, f"guard.{name}.following_error.window"):
            if value > FAR:
                units.append((place, f"{value:g} rad or m is no limb that follows. Are these degrees or millimetres?"))
    units += _of_ages(profile, devices, laws)
    old = dict(_old_keys(devices, [law.controller for law in laws], world))
    intended = {each: _by_new_name(each, old) for each in profile.meant}
    idle = [each for each, new in intended.items() if not any(_within(place, (new,)) for place, _ in units)]
    units = [(place, text) for place, text in units if not _within(place, tuple(intended.values()))]
    if units and any(d.commands and d.name not in simulated for d in devices):
        place, text = units[0]
        raise WiringError(source.place(place), text, f"Correct it; if it is meant so, add `meant: [{place}]`")
    found = units
    found += [(f"meant.{i}", f"{each}: there is no number in doubt") for i, each in enumerate(idle)]
    found += _of_simulation(profile, laws, simulated)
    found += [
        (f"devices.{d.name}.{d.simulated}", "it was made in simulation, and the device is real: calibrate")
        for d in devices
        if d.simulated and d.name not in simulated
    ]
    found += _of_bodies(profile, laws)
    found += robots.warnings(
        profile, devices, options(profile, devices, [law.controller for law in laws], world, clearances)
    )
    found += _of_rows(profile)
    for name, other in shared([device for device in devices if device.name not in simulated]):
        found.append((f"devices.{name}.port", f"{other} is at this port, too, and only one can have it open"))
    found += [(f"sim.{key}", text) for key, text in (world.warnings if world is not None else ())]
    found += [
        (place, f"it is now called '{new}'; the old name still works (`srl migrate` writes the new one)")
        for place, new in old.items()
    ]
    found += _of_worn(profile, laws)
    for i, law in enumerate(laws):
        found += [(f"controllers.{i}.{key}", text) for key, text in law.controller.warnings(1.0 / float(profile.rate))]
    found += [(f"guard.{name}.clear", text) for name, each in clearances.items() for text in each.unmet]
    for name, frame in profile.frames.items():
        if "/" in (frame.parent or ""):
            for i, value in enumerate(frame.position):
                if REACH < abs(value) <= ROOM:
                    found += _doubt(f"frames.{name}.position.{i}", value, "m", REACH)
    return [f"{source.place(place)}: {text}" for place, text in found]


def _of_ages(profile: Profile, devices: Sequence[Driver], laws: Sequence[Law]) -> Iterator[tuple[str, str]]:
    """Times in milliseconds: the loss of a device, of a client, or of a limb that is blocked, would stop nothing."""
    ages: list[tuple[str, float | None]] = [(f"devices.{device.name}.max_age", device.max_age) for device in devices]
    ages += [(f"setpoints.{name}.max_age", entry.max_age) for name, entry in profile.setpoints.items()]
    ages += [
        (f"guard.{name}.following_error.timeout", getattr(limits.following_error, "timeout", None))
        for name, limits in profile.guard.items()
    ]
    ages += [
        (f"controllers.{i}.max_hold", getattr(law.controller.config, "max_hold", None)) for i, law in enumerate(laws)
    ]
    for place, age in ages:
        if age is not None and OLD < age < inf:
            meant = f"Are these milliseconds? {age:g} ms are {age / 1000:g} s"
            yield place, f"what is {age:g} s old says nothing about now. {meant}"


def _within(place: str, meant: tuple[str, ...]) -> bool:
    """Whether a place is one of these, or an element of one of them."""
    return any(each in (place, place.rpartition(".")[0]) for each in meant)


def old_names(graph: Graph) -> dict[str, str]:
    """The new name by the place of each key by an old name."""
    return dict(_old_keys(graph.devices, graph.controllers, graph.world))


def _old_keys(
    devices: Sequence[Driver], controllers: Sequence[Controller], world: World | None
) -> Iterator[tuple[str, str]]:
    for i, controller in enumerate(controllers):
        yield from old_keys(controller.config, f"controllers.{i}")
    for device in devices:
        yield from old_keys(device.config, f"devices.{device.name}")
    if world is not None:
        for place, new in old_keys(world.config, "sim"):
            yield re.sub(r"^(sim\.parts\.[^.]+)\.1\.", r"\1.", place), new  # a part's class and its options


def _by_new_name(place: str, old: Mapping[str, str]) -> str:
    """A place of `meant:`, with the new name of a key that has one."""
    for each, new in old.items():
        if place == each or place.startswith(f"{each}."):
            return f"{each.rpartition('.')[0]}.{new}{place.removeprefix(each)}"
    return place


def _position_unit(command: Command | None) -> str:
    """The unit of a command's position: rad for rad/s and N m."""
    unit = command.unit if command is not None else ""
    return {"rad/s": "rad", "N m": "rad", "m/s": "m", "N": "m"}.get(unit, unit)


def _of_simulation(profile: Profile, laws: list[Law], simulated: list[str]) -> Iterator[tuple[str, str]]:
    """Files that the simulation made, of laws that real devices feed, themselves or by way of laws before."""
    real: dict[str, str] = {name: name for name in profile.devices if name not in simulated}
    for i, law in enumerate(laws):
        owners = (far.partition(".")[0] for wire in law.inputs.values() for far in wire.far)
        fed = next((real[owner] for owner in owners if owner in real), None)
        if fed is None:
            continue
        real[law.controller.name] = fed
        if option := law.controller.simulated:
            text = f"it was made in simulation, and '{fed}' is real. It says nothing about a real one: calibrate"
            yield f"controllers.{i}.{option}", text


def _of_bodies(profile: Profile, laws: list[Law]) -> Iterator[tuple[str, str]]:
    """Calibrations whose angles were measured by another body: their zeros are others, so every value is."""
    now = list(bodies(profile.models).values())
    for i, law in enumerate(laws):
        if any(body not in now for body in law.controller.measured_by.values()):
            text = "it was made with another body than `models:` has now, so its angles mean others: calibrate again"
            yield f"controllers.{i}.calibration", text


def _of_worn(profile: Profile, laws: list[Law]) -> Iterator[tuple[str, str]]:
    """Worn arms without `clear:`. They are the devices that feed a law of such arms beside the body's pose."""
    worn = {
        far.partition(".")[0]
        for law in laws
        if isinstance(getattr(law.controller.config, "arms", None), ArmsModel) and "rotation" in law.inputs
        for wire in law.inputs.values()
        for far in wire.far
    }
    for name, limits in profile.guard.items():
        if name.partition(".")[0] in worn and limits.clear is None:
            yield f"guard.{name}", "nothing keeps this arm clear of its wearer: add `clear:` (docs/collision.md)"


def _of_rows(profile: Profile) -> Iterator[tuple[str, str]]:
    """The Denavit-Hartenberg rows, whose columns have units of their own."""
    for name, model in profile.models.items():
        for i, (alpha, a) in enumerate(getattr(model, "rows", ())):
            yield from _doubt(f"models.{name}.rows.{i}.0", alpha, "rad")
            yield from _doubt(f"models.{name}.rows.{i}.1", a, "m", REACH)


def _of_option(path: str, field: FieldInfo, value: Any) -> Iterator[tuple[str, str]]:
    unit = _UNIT.match(field.description or "")
    if unit is not None:
        for place, number in _numbers(value, path):
            yield from _doubt(place, number, unit[1], _longest(path, field.description or ""))
    if path.endswith("quaternion") and value is not None and abs(hypot(*value) - 1.0) > 0.01:
        yield path, f"its length is {hypot(*value):.3g}, not 1: is one of its numbers wrong?"


def _numbers(value: Any, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield path, float(value)
    else:
        for key, item in items(value):
            yield from _numbers(item, f"{path}.{key}")


def _longest(path: str, description: str) -> float:
    if ".off_by." in path:
        return NEAR
    return REACH if "centre of mass" in description or "in the flange's frame" in description else ROOM


def _doubt(place: str, value: float, unit: str, longest: float = ROOM) -> Iterator[tuple[str, str]]:
    size = abs(value) if isfinite(value) else -inf
    if unit == "rad" and size > TURN:
        meant = f"{value:g} degrees are {radians(value):.4g} rad"
        yield place, f"{value:g} rad is {size / (2 * pi):.3g} turns. Are these degrees? {meant}"
    elif unit == "m" and size > longest:
        what = "a room" if longest == ROOM else "a limb" if longest == REACH else "a mount is off by"
        yield place, f"{value:g} m is more than {what}. Are these millimetres? {value:g} mm are {value / 1000:g} m"
    elif unit == "kg" and size > PERSON:
        yield place, f"{value:g} kg is more than a person. Are these grams? {value:g} g are {value / 1000:g} kg"
