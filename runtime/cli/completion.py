"""What a shell's TAB key offers: commands, options, and the names that this machine knows (argcomplete)."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import Any

import argcomplete

from srl.runtime.contracts import registry
from srl.runtime.ipc.run_folder import running
from srl.runtime.profile import library


def answer(parser: argparse.ArgumentParser) -> None:
    """Tells the shell what could come next, and ends the process. Returns only if no shell asks."""
    _equip(parser)
    argcomplete.autocomplete(parser)


def _equip(parser: argparse.ArgumentParser) -> None:
    """Gives the arguments their completers, those of the commands included. Other arguments are files to a shell."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                _equip(inner)
        elif (
            completer := _COMPLETERS.get((parser.prog.split()[-1], action.dest)) or _ANYWHERE.get(action.dest)
        ) is not None:
            vars(action)["completer"] = completer


def _profiles(prefix: str, **given: Any) -> Iterable[str]:
    yield from library.shipped()
    yield from argcomplete.FilesCompleter(("yaml", "yml"))(prefix, **given)


def _instances(**_: Any) -> Iterable[str]:
    return [folder.path.name for folder in running()]


def _studies(**_: Any) -> Iterable[str]:
    return registry.names("studies")


_ANYWHERE: dict[str, Callable[..., Iterable[str]]] = {"profile": _profiles}
_COMPLETERS: dict[tuple[str, str], Callable[..., Iterable[str]]] = {
    ("study", "name"): _studies,
    ("new", "template"): lambda **_: library.shipped(),
} | {(command, "instance"): _instances for command in ("stop", "reset", "start", "top", "panel", "set")}
