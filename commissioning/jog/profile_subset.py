"""The part of a profile that `srl jog` runs: one device under its own guard, and a law that takes the keys.

The guard's limits, the stop, the reactions to faults, the rate and the clock stay as they are, but for `retract`: the
limb holds instead. Emergency inputs stay, with the devices that give them if these only measure. Everything else is
left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from srl.control.setpoint.jog import HOLD
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import ProfileError, RequestError, WiringError, nearest
from srl.runtime.contracts.signals import Command, Kind, Stop
from srl.runtime.contracts.terms import PLANAR_TWIST
from srl.runtime.ipc import latches, presses
from srl.runtime.ipc.header import Latch
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.builder import Builder
from srl.runtime.profile.graph import Actuator, Graph
from srl.runtime.profile.part import frames_left, parsed
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

LAW: Final = "jog"
WAY: Final = "terminal.way"
PRESS: Final = "terminal.press"
SILENCE: Final = 0.5  # s without a word of the terminal after which the limb stops
SPEED: Final = 0.1  # rad/s
FASTEST: Final = 0.5  # rad/s
SLIDES: Final = 5  # a joint that slides moves at a fifth of the number, in m/s
RAMP: Final = 0.05  # s in which a joint comes to its speed, if the guard lets it
COAST: Final = 0.3  # s in which a joint brakes, at most: from a higher speed it would go on too far
SLOWEST: Final = 20.0  # Hz of the loop, below which a press can't be timed
_DROPPED: Final = ("setpoints", "reset", "record", "bus")


@dataclass(frozen=True)
class ProfileSubset:
    """The cut profile.

    Attributes:
        profile, source: it.
        graph: the system built of it.
        actuator: what is moved.
        speed: rad/s, m/s or the command's own unit, by joint.
        units: of each joint's position: "rad", "m", "1".
        left_out: emergency inputs of the whole profile that aren't there.
        sim: its devices that are simulated, [] for all; None: none is.
        twins: its devices that are on their twins.
    """

    profile: Profile
    source: Source
    graph: Graph
    actuator: Actuator
    speed: dict[str, float]
    units: dict[str, str]
    left_out: tuple[str, ...]
    sim: list[str] | None
    twins: frozenset[str] = frozenset()

    @property
    def real(self) -> bool:
        """Whether what is moved is a real device."""
        return self.graph.devices[self.actuator.device].name not in self.twins.union(self.graph.simulated)


def subset(
    checked: Profile, source: Source, device: str | None, speed: float, sim: Sequence[str] | None, panel: bool = False
) -> ProfileSubset:
    """Cuts a profile to one device.

    Args:
        checked, source: the whole profile.
        device: its name; None: the only one that takes commands.
        speed: rad/s; joints that slide move at a fifth of it, in m/s. The guard's own limit holds, too.
        sim: the devices that are simulated, [] for all; None: none is.
        panel: the presses come from the operator's panel, which tells of a key that is let go: each moves for less.
    Raises:
        RequestError: there is no such device, several, or the speed is out of bounds.
        SrlError: it can't be moved by a position or a velocity, or the profile is wrong.
    """
    if not 0.0 < speed <= FASTEST:
        problem = f"{speed:g} rad/s is out of bounds"
        remedy = f"Give more than 0 and at most {FASTEST:g}; joints that slide move at a fifth of it, in m/s"
        raise RequestError("--speed", problem, remedy)
    slowest = presses.SLOWEST if panel else SLOWEST
    if checked.rate < slowest:
        problem = f"at {float(checked.rate):g} Hz a key's press can't be timed"
        raise RequestError(source.place("rate"), problem, f"Jog at {slowest:g} Hz or more: --set rate={slowest:g}")
    parts = Builder(checked, source, sim)
    name = device if device is not None else _only(parts, sim or ())
    if name not in checked.devices:
        raise RequestError(source.label, f"the profile has no device '{name}'", nearest(name, checked.devices))
    command = _command(parts, name)
    full = f"{name}.{command.name}"
    limits = checked.guard.get(full)
    if limits is not None and limits.clear is not None:
        place = source.place(f"guard.{full}.clear")
        problem = "it keeps the limb clear of what other devices measure, and they are left out here"
        remedy = f"If nobody wears the limb or is near it, jog without: --set guard.{full}.clear=null"
        raise WiringError(place, problem, remedy)
    owners = [entry.signal.partition(".")[0] for entry in checked.emergency]
    # A second limb would be switched on, too, and nothing would command it.
    stays = [i for i, owner in enumerate(owners) if owner == name or _measures(parts, owner)]
    left_out = tuple(entry.signal for i, entry in enumerate(checked.emergency) if i not in stays)
    speeds, law = _law(checked, source, full, command, speed)
    law["hold"] = presses.MOVES if panel else HOLD
    made, own = _part(checked, source, {name, *(owners[i] for i in stays)}, name, stays, law, sim is not None)
    kept = [each for each in sim or () if each in made.devices]
    here = kept if kept or sim == [] else None  # what is simulated may all be left out
    graph = wiring.build(made, own, here)
    (actuator,) = graph.actuators
    return ProfileSubset(made, own, graph, actuator, speeds, _units(command), left_out, here)


def _driver(parts: Builder, name: str) -> Driver:
    """A device's driver, which isn't opened."""
    entry, path = parts.profile.devices[name], f"devices.{name}"
    cls = parts.source.load("drivers", entry.driver, f"{path}.driver")
    made: Driver = cls(name, parts.options(cls.Config, entry.options, path))
    return made


def _measures(parts: Builder, name: str) -> bool:
    """Whether it is a device that takes no commands."""
    return name in parts.profile.devices and not _driver(parts, name).commands


def _only(parts: Builder, sim: Sequence[str]) -> str:
    """The only device that takes commands, or the only one of these that `--sim` names."""
    able = []
    for name, entry in parts.profile.devices.items():
        cls = parts.source.load("drivers", entry.driver, f"devices.{name}.driver")
        if cls.takes and not _measures(parts, name):  # a driver's own options may name files, so only where it counts
            able.append(name)
    for found in (able, [name for name in able if name in sim]):
        if len(found) == 1:
            return found[0]
    problem = f"{len(able)} of its devices take commands" if able else "none of its devices takes commands"
    remedy = f"Name one: {', '.join(able)}" if able else "Name a profile of a limb"
    raise RequestError(parts.source.label, problem, remedy)


def _command(parts: Builder, device: str) -> Command:
    """The device's command, a position or a velocity."""
    place, found = parts.source.place(f"devices.{device}"), _driver(parts, device).commands
    if not found:
        able = [n for n in parts.profile.devices if n != device and not _measures(parts, n)]
        remedy = f"Name one that moves: {', '.join(able)}" if able else "Name a profile of a limb"
        raise RequestError(place, "the device takes no commands", remedy)
    if len(found) > 1:
        problem = f"it takes {len(found)} commands, and only one can be jogged"
        raise WiringError(place, problem, "Leave the others out of the profile")
    if found[0].kind not in (Kind.POSITION, Kind.VELOCITY):
        problem = f"it takes '{found[0].name}', neither a position nor a velocity"
        remedy = "Choose such a command of its driver with --set (docs/devices), and give it limits in `guard:`"
        raise WiringError(place, problem, remedy)
    return found[0]


def _part(
    checked: Profile, source: Source, kept: set[str], device: str, stays: Sequence[int], law: dict[str, Any], sim: bool
) -> tuple[Profile, Source]:
    """The profile of the devices `kept`, of which `device` moves by the entry `law`.

    `stays`: the places of the emergency inputs that are kept.
    """
    whole, _ = profile.tree(source.label, source.text, source.overrides, source.files)
    plain = {key: value for key, value in whole.items() if key not in _DROPPED}
    (command,) = {target.removesuffix(".velocity") for target in law["out"].values()}
    joints = list(law["speed"])
    plain["devices"] = {name: entry for name, entry in whole["devices"].items() if name in kept}
    plain["controllers"] = [law]
    plain["setpoints"] = {
        WAY: {"shape": [len(joints)], "unit": "1", "labels": joints, "max_age": SILENCE},
        PRESS: {"shape": [1], "unit": "1", "max_age": SILENCE},
    }
    plain["guard"] = {name: entry for name, entry in (whole.get("guard") or {}).items() if name == command}
    # Nothing goes home by itself while a lab still finds out which way is which.
    stop = {name: entry for name, entry in (whole.get("stop") or {}).items() if name == device}
    plain["stop"] = {name: str(Stop.HOLD) if entry == Stop.RETRACT else entry for name, entry in stop.items()}
    faults = (whole.get("faults") or {}).items()
    plain["faults"] = {name: "stop" if entry == Stop.RETRACT else entry for name, entry in faults}
    # Nor by a reset after a loss; and no reset hides a switch that this run doesn't read.
    plain["reset"] = {"unmeasured": "refuse"}
    if len(stays) < len(checked.emergency):
        plain["reset"]["keeps"] = latches.names(Latch.EMERGENCY)
    plain["emergency"] = [dict(whole["emergency"][i]) for i in stays]
    for entry in plain["emergency"]:
        if entry.get("category") == Stop.RETRACT:
            entry["category"] = "stop"
    if plain.get("clock") not in kept:
        plain.pop("clock", None)
    plain["frames"] = frames_left(checked, whole.get("frames") or {}, kept, [], sim)
    if whole.get("sim"):
        plain["sim"] = {k: v for k, v in whole["sim"].items() if k not in ("ends_with", "duration")}
        plain["sim"]["devices"] = {n: v for n, v in (whole["sim"].get("devices") or {}).items() if n in kept}
    return parsed(plain, source, [])


def _law(
    checked: Profile, source: Source, name: str, command: Command, speed: float
) -> tuple[dict[str, float], dict[str, Any]]:
    """The speed of each joint, and the entry of the law that moves them; `name` is the command's."""
    joints, units = command.names, _units(command)
    entry = checked.guard.get(name)
    limits = None
    if entry is not None:
        limits = entry.to_limits(command.shape, source.place(f"guard.{name}"), command.labels, command.ordered)
    speeds, ramps = {}, {}
    # A position is told to the guard, which must keep up with it; a velocity's change is the guard's own.
    share = 0.5 if command.kind is Kind.POSITION else 1.0
    for i, joint in enumerate(joints):
        most = float(limits.velocity.flat[i]) if limits is not None and limits.velocity is not None else speed
        wanted = speed / SLIDES if units[joint] == "m" else speed
        speeds[joint] = min(wanted, most)
        ramps[joint] = speeds[joint] / RAMP
        if limits is not None and limits.acceleration is not None:
            ramps[joint] = min(ramps[joint], share * float(limits.acceleration.flat[i]))
        speeds[joint] = min(speeds[joint], COAST * ramps[joint])
        if not (speeds[joint] > 0.0 and ramps[joint] > 0.0):
            place = source.place(f"guard.{name}")
            raise ProfileError(place, f"it lets '{joint}' not move at all", "Give it a velocity and an acceleration")
    outputs = {"velocity": name}
    if command.kind is Kind.POSITION:
        outputs = {"q": name, "q_velocity": f"{name}.velocity"}
    law: dict[str, Any] = {
        "use": LAW, "speed": speeds, "acceleration": ramps, "command": str(command.kind), "unit": command.unit,
        "in": {"way": WAY, "press": PRESS}, "out": outputs,
    }  # fmt: skip
    if command.slides is not None:
        law["slides"] = list(command.slides)
    return speeds, law


def _units(command: Command) -> dict[str, str]:
    """The unit of each joint's position."""
    if command.labels == PLANAR_TWIST:
        return dict(zip(command.labels, ("m", "m", "rad"), strict=True))
    unit = command.unit.removesuffix("/s")
    slides = command.slides or ()
    return {joint: "m" if joint in slides else unit for joint in command.names}
