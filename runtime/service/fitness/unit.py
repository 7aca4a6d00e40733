"""Checks the systemd unit, if it is installed: whether the service can start the program that it names.

With `ProtectHome=yes` a service sees no home directories. An environment whose interpreter lies in one (pyenv, uv and
conda put it there) fails with 203/EXEC, though it works in every shell.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from pathlib import Path

from srl.runtime.service.fitness.finding import Finding, read

UNIT = "srl@.service"
_FOLDERS = ("/usr/lib/systemd/system", "/lib/systemd/system", "/etc/systemd/system")
_HIDDEN = ("/home", "/root", "/run/user")  # systemd.exec(5), ProtectHome=
_VENV = "sudo /usr/bin/python3 -m venv --clear /opt/srl-1 && sudo /opt/srl-1/bin/pip install ."


def service() -> Finding:
    """Whether the installed service can be started."""
    units = [path for folder in _FOLDERS if (path := Path(folder) / UNIT).is_file()]
    if not units:
        return _without(Path(sys.executable))
    unit = units[-1]  # what is in /etc comes first
    settings = _settings(unit)
    program = Path(settings.get("ExecStart", ["/opt/srl/bin/srl"])[-1])
    if not program.exists():
        remedy = "Install there as docs/deployment.md says, or name the right path with `systemctl edit srl@.service`"
        return Finding("service", "bad", f"{unit} starts {program}, which isn't there", remedy, _VENV)
    if settings.get("ProtectHome", ["no"])[-1] not in ("yes", "true", "on", "1", "tmpfs"):
        return Finding("service", "good", f"{unit} starts {program}")
    if (hidden := _hidden(program)) is not None:
        return Finding(
            "service", "bad",
            f"{unit} starts {program}, which needs {hidden}: ProtectHome= hides that, so it fails with 203/EXEC",
            "Take a Python of the system for the environment", _VENV,
        )  # fmt: skip
    return Finding("service", "good", f"{unit} starts {program}")


def _without(python: Path) -> Finding:
    at = _below_home(python)
    remedy = "" if at is None else f"A service couldn't start this Python ({at}): docs/deployment.md, Install"
    return Finding("service", "good", f"{UNIT} isn't installed", remedy)


def _settings(unit: Path) -> dict[str, list[str]]:
    """The values of each key, of the unit and its drop-ins in their order; an empty value forgets those before."""
    found: dict[str, list[str]] = {}
    parts = [path for folder in _FOLDERS for path in Path(folder).glob(f"{UNIT}.d/*.conf")]
    for path in (unit, *sorted(parts, key=lambda path: path.name)):
        for line in read(path).splitlines():
            if match := re.match(r"\s*(ExecStart|ProtectHome)\s*=\s*(.*)", line):
                key, value = match.groups()
                found.setdefault(key, [])
                if value:
                    program = re.search(r"/\S*/bin/srl\b", value)  # a shell may stand before it
                    found[key].append(program[0] if program else value.split()[0].lstrip("@-:+!"))
                else:
                    found[key] = []
    return {key: values for key, values in found.items() if values}


def _hidden(program: Path) -> Path | None:
    """What of a program lies in a home directory: itself or its interpreter, wherever links lead; None if nothing."""
    if (at := _below_home(program)) is not None:
        return at
    try:
        with program.open("rb") as file:
            head = file.readline(4096)
    except OSError:
        return None
    if not head.startswith(b"#!") or not (words := shlex.split(os.fsdecode(head[2:]).strip())):
        return None
    return _below_home(Path(words[0]))


def _below_home(path: Path) -> Path | None:
    """Where a path or a link on the way from it lies in a home directory."""
    for _ in range(40):  # links, as many as the kernel follows
        folder = path.parent.resolve()
        path = folder / path.name
        if any(path.is_relative_to(home) for home in _HIDDEN):
            return path
        if not path.is_symlink():
            return None
        path = folder / os.readlink(path)
    return None
