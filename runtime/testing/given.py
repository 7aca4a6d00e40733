"""A profile as a test gives it: a path, a name, its text, or its keys."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.contracts.files import Files
from srl.runtime.profile import profile
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source

Given = str | Path | Mapping[str, Any]


def read(given: Given, overrides: Sequence[str] = ()) -> tuple[Profile, Source]:
    """Reads and checks a profile.

    Args:
        given: a path; the name of a profile that comes with srl; YAML text, which has more than one line; or the keys.
        overrides: as for `srl run`, with `--set`.
    Raises:
        ProfileError: as `srl check` says it.
    """
    here = Files(run_code=True)  # a test's own
    if isinstance(given, Mapping):
        return profile.parse("profile.yaml", json.dumps(given), overrides, here)  # JSON is YAML
    if isinstance(given, Path):
        return profile.load(f"./{given}" if given.parent == Path() else str(given), overrides)
    if "\n" in given:
        return profile.parse("profile.yaml", given, overrides, here)
    return profile.load(given, overrides)


def driver_of(checked: Profile, source: Source, device: str) -> str:
    """The registered name of a device's driver. Raises ProfileError: the profile has no such device."""
    if device not in checked.devices:
        raise ProfileError(source.place("devices"), f"there is no '{device}'", nearest(device, checked.devices))
    return checked.devices[device].driver
