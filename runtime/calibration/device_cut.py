"""A device that is calibrated: which it is, the file that it names, and the part of the profile that it needs.

Nothing moves: the device alone is left, with the law that marks the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from runtime.calibration.cut import DROPPED, build
from runtime.contracts import registry
from runtime.contracts.errors import OptionError, ProfileError, RequestError, nearest
from runtime.profile import profile
from runtime.profile.graph import Graph
from runtime.profile.part import parsed
from runtime.profile.profile import Profile
from runtime.profile.source import Source


def device(checked: Profile, source: Source, what: str, chosen: str = "") -> str:
    """The device that is calibrated.

    Args:
        checked, source: the whole profile.
        what: what `srl calibrate` calls its calibration, `Driver.calibrated`.
        chosen: its name, if it was said.
    Raises:
        ProfileError: there is none. RequestError: there are several, or `chosen` is none of them.
    """
    found = [
        name
        for name, entry in checked.devices.items()
        if registry.load("drivers", entry.driver, source.place(f"devices.{name}.driver")).calibrated == what
    ]
    if not found:
        problem = f"none of its devices is calibrated by '{what}'"
        raise ProfileError(source.place("devices"), problem, "Name a profile that has one")
    if chosen:
        if chosen not in found:
            problem = f"'{chosen}' is no device that is calibrated by '{what}'"
            raise RequestError("--option device", problem, nearest(chosen, found))
        return chosen
    if len(found) > 1:
        problem = f"the profile has {len(found)} such devices: {', '.join(found)}"
        raise RequestError("--option device", problem, f"Name one: --option device={found[0]}")
    return found[0]


def named(checked: Profile, source: Source, name: str, option: str = "calibration") -> Path | None:
    """The file that a device's option names, if it names one. Raises ProfileError."""
    given = checked.devices[name].options.get(option)
    if not isinstance(given, str):
        return None
    try:
        return source.files.find(given)
    except OptionError as error:
        raise ProfileError(source.place(f"devices.{name}.{option}"), error.problem, error.remedy) from None


def cut_to_device(
    checked: Profile, source: Source, name: str, change: Callable[[dict[str, Any]], None],
    marks: Callable[[Graph], dict[str, Any]], sim: bool,
) -> tuple[Profile, Source]:  # fmt: skip
    """The profile of one device, with the marks' law at its end.

    Args:
        checked, source: the whole profile.
        name: the device.
        change: changes what is left of the profile: the device's options, the simulated world.
        marks: makes the entry of the marks' law.
        sim: it is simulated.
    Raises:
        ProfileError, WiringError: what is left can't be built.
    """
    plain, _ = profile.tree(source.label, source.text, source.overrides, source.files)
    for key in DROPPED:
        plain.pop(key, None)
    plain["devices"] = {name: plain["devices"][name]}
    plain["bus"], plain["frames"], plain["controllers"] = None, {}, []
    if plain.get("clock") != name:
        plain.pop("clock", None)
    if plain.get("sim"):
        plain["sim"]["devices"] = {n: v for n, v in (plain["sim"].get("devices") or {}).items() if n == name}
        for key in ("ends_with", "duration"):
            plain["sim"].pop(key, None)
    change(plain)
    plain["controllers"] = [marks(build(*parsed(plain, source, []), sim))]
    return parsed(plain, source, [])
