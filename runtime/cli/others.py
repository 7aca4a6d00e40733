"""Commands of `srl` that come by entry points (`srl.commands`), from this package and from anyone's.

`importlib.metadata` takes longer to load than all else of `srl --help`, so the installed packages' lists of entry
points are read here.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from types import ModuleType

from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import HostError

GROUP = "srl.commands"


def commands() -> dict[str, list[str]]:
    """The modules of each command, by its name: one, or more if several packages claim the name."""
    found: dict[str, list[str]] = {}
    for text in dict.fromkeys(_lists()):
        for name, module in _entries(text):
            if module not in found.setdefault(name, []):
                found[name].append(module)
    return found


def load(name: str, modules: Sequence[str]) -> ModuleType:
    """The module of a command. Raises HostError: it can't be imported, or isn't one, or two packages claim it."""
    path = modules[0]
    if len(modules) > 1:
        problem = f"'{name}' is claimed by {' and '.join(modules)}"
        raise HostError(f"entry points {GROUP}", problem, "Uninstall all of these packages but one")
    try:
        found = importlib.import_module(path)
    except Exception as error:  # a package of somebody else mustn't keep the others from their work
        problem = f"command '{name}' ({path}) can't be imported: {type(error).__name__}: {error}"
        raise HostError(f"srl {name}", problem, extras.import_remedy(error)) from error
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
