"""Finds the running instance to which a command refers."""

from __future__ import annotations

from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.ipc.run_folder import RunFolder, base, running


def choose(name: str | None) -> RunFolder:
    """Returns the running instance called `name`, or the only one. Raises RequestError."""
    found = {run_folder.path.name: run_folder for run_folder in running()}
    if name is not None:
        if name not in found:
            raise RequestError(f"instance '{name}'", f"it isn't running (looked in {base()})", nearest(name, found))
        return found[name]
    if not found:
        raise RequestError("no instance", f"nothing runs on this host (looked in {base()})", "Start one with `srl run`")
    if len(found) > 1:
        raise RequestError("which instance", f"{len(found)} run here: {', '.join(found)}", "Name one of them")
    return next(iter(found.values()))
