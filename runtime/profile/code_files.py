"""The entries of a profile whose class is in a file (`srl.runtime.contracts.code_file`)."""

from __future__ import annotations

from srl.runtime.contracts import code_file
from srl.runtime.contracts.files import KeptFile
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source


def names(profile: Profile) -> dict[str, str]:
    """By key path: the names of laws and drivers that mean a class in a file."""
    found = {f"devices.{name}.driver": entry.driver for name, entry in profile.devices.items()}
    found |= {f"controllers.{i}.use": entry.use for i, entry in enumerate(profile.controllers)}
    return {path: name for path, name in found.items() if code_file.is_file(name)}


def files(profile: Profile, source: Source) -> dict[str, KeptFile]:
    """By key path: the files in which they are. Raises ProfileError: one can't be read."""
    return {path: code_file.kept(name, source.files, source.place(path)) for path, name in names(profile).items()}


def remarks(profile: Profile, source: Source) -> list[str]:
    """What a person should know: whose code is run, a line each."""
    return [
        f"{source.place(path)}: the code in {name.rpartition(':')[0]} is run" for path, name in names(profile).items()
    ]
