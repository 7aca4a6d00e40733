"""Finds the running instance to which a command refers."""

from __future__ import annotations

import os
import pwd

from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.ipc import run_folder as folders
from srl.runtime.ipc.run_folder import RunFolder, base, running
from srl.runtime.profile.keys import slug


def choose(name: str | None) -> RunFolder:
    """Returns the running instance called `name`, or so on the bus, or the only one. Raises RequestError."""
    found = {run_folder.path.name: run_folder for run_folder in running()}
    if name is not None:
        same = [run_folder for other, run_folder in found.items() if slug(other) == name]
        if name in found or len(same) == 1:
            return found.get(name) or same[0]
        _look_whose(name)
        raise RequestError(f"instance '{name}'", f"it isn't running (looked in {_looked()})", nearest(name, found))
    if not found:
        raise RequestError(
            "no instance", f"nothing runs on this host (looked in {_looked()})", "Start one with `srl run`"
        )
    if len(found) > 1:
        raise RequestError("which instance", f"{len(found)} run here: {', '.join(found)}", "Name one of them")
    return next(iter(found.values()))


def _looked() -> str:
    return " and ".join(dict.fromkeys((str(base()), str(folders.SERVICES))))


def _look_whose(name: str) -> None:
    """Raises RequestError: there is a folder for that name, and this user can't see whether its instance runs."""
    for path in (base() / name, folders.SERVICES / name):
        for folder in (path.parent, path):
            if os.path.isdir(folder) and not os.access(folder, os.R_OK | os.X_OK, effective_ids=True):
                uid = folder.stat().st_uid
                try:
                    owner = pwd.getpwuid(uid).pw_name
                except KeyError:
                    owner = str(uid)
                problem = f"{folder} is of user {owner} and can't be read, so whether it runs isn't known"
                raise RequestError(f"instance '{name}'", problem, "Ask as that user, as one of its group, or as root")
