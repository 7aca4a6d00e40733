"""A device that is calibrated: which it is, and the file that it names.

`subset_of_devices` leaves it alone in a profile.
"""

from __future__ import annotations

from pathlib import Path

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import OptionError, ProfileError, RequestError, nearest
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


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
