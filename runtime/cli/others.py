"""Commands of `srl` that come by entry points (`srl.commands`), from this package and from anyone's.

`importlib.metadata` takes longer to load than all else of `srl --help`, so the installed packages' lists of entry
points are read here.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Mapping
from types import ModuleType

from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import HostError

GROUP = "srl.commands"


def commands() -> dict[str, str]:
    """The module of each command, by its name; of one that two packages claim both, with a comma between."""
    found: dict[str, str] = {}
    for text in dict.fromkeys(_lists()):
        if f"[{GROUP}]" in text:
            for name, module in _entries(text):
                if module not in found.setdefault(name, module).split(", "):
                    found[name] += f", {module}"
    return found


def module(name: str, path: str) -> ModuleType:
    """The module of a command. Raises HostError: it can't be imported, or isn't one, or two packages claim it."""
    if ", " in path:
        problem = f"'{name}' is claimed twice, by {path.replace(', ', ' and ')}"
        raise HostError(f"entry points {GROUP}", problem, "Uninstall one of the packages")
    try:
        found = importlib.import_module(path)
    except Exception as error:  # a package of somebody else mustn't keep the others from their work
        problem = f"command '{name}' ({path}) can't be imported: {type(error).__name__}: {error}"
        raise HostError(f"srl {name}", problem, extras.of_import(error)) from error
    texts = getattr(found, "COMMANDS", None)
    if not isinstance(texts, Mapping) or name not in texts or not hasattr(found, "add_parser"):
        problem = f"{path} has no COMMANDS with '{name}', or no add_parser"
        raise HostError(f"srl {name}", problem, "docs/extending.md says what a command's module has")
    return found


def _lists() -> Iterator[str]:
    """The entry points of each installed package, as text."""
    for folder in sys.path:
        try:
            names = sorted(os.listdir(folder or "."))
        except OSError:
            continue
        for name in names:
            if name.endswith((".dist-info", ".egg-info")):
                try:
                    with open(os.path.join(folder or ".", name, "entry_points.txt"), encoding="utf-8") as file:
                        yield file.read()
                except (OSError, UnicodeDecodeError):
                    continue


def _entries(text: str) -> Iterator[tuple[str, str]]:
    section = ""
    for line in text.splitlines():
        if line.strip().startswith("["):
            section = line.strip()
        elif section == f"[{GROUP}]" and "=" in line:
            name, _, value = line.partition("=")
            yield name.strip(), value.strip()
