"""`srl migrate`: writes the new names of options into a profile that an older version of srl was made for."""

from __future__ import annotations

import argparse
import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from ruamel.yaml.comments import CommentedMap, CommentedSeq

from srl.commissioning.cli import COMMANDS
from srl.runtime.cli import add_command, options
from srl.runtime.contracts import whole_file, yaml_text
from srl.runtime.contracts.errors import ProfileError, RequestError
from srl.runtime.contracts.files import Files
from srl.runtime.ipc import older
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.plausibility import old_names
from srl.runtime.profile.source import written

Names = dict[str, str]
"""The new name by the key path, in the file, of the old one."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "migrate", "srl migrate my-limb.yaml", COMMANDS)
    options.profile(parser, text="a path to a YAML file")
    parser.add_argument("--dry-run", action="store_true", help="say what would be changed, and change nothing")
    options.as_json(parser, "the changes as one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Changes the file, keeps what was there, and says what it did. Returns 0. Errors are raised."""
    path = Path(args.profile).resolve()  # a link stays one
    if not path.is_file():
        problem = "it isn't a file" if path.exists() else "there is no such file"
        raise RequestError(args.profile, problem, "Give your profile's file, such as my-limb.yaml")
    if not os.access(path, os.W_OK):
        raise RequestError(args.profile, "it can't be written", "Let its owner do it, or change its rights")
    label, text, folder = profile.find(str(path))
    found = _old(label, text, folder)
    made, lines = _renamed(text, found)
    if left := _old(label, made, folder):
        place, new = next(iter(left.items()))
        raise ProfileError(f"{args.profile}: {place}", "it can't be renamed by itself", f"Write '{new}' there")
    kept = None
    if found and not args.dry_run:
        kept = older.keep(path)
        assert kept is not None
        shutil.copystat(path, kept)
        rights = path.stat()
        whole_file.write(path, made.encode(), RequestError)
        path.chmod(rights.st_mode)
        with suppress(OSError):
            os.chown(path, rights.st_uid, rights.st_gid)
    changes = [{"line": line, "place": place, "to": found[place]} for line, place in lines]
    if args.json:
        import json

        print(json.dumps({"changes": changes, "kept": None if kept is None else str(kept)}))
        return 0
    for change in changes:
        print(f"{args.profile} line {change['line']}: {change['place']} is called {change['to']} now")
    if kept is not None:
        print(f"{args.profile} is changed; it was as {kept} is")
    elif not found:
        print(f"{args.profile} has no old names. Calibrations and recordings are read as they are")
    return 0


def _old(label: str, text: str, folder: Path) -> Names:
    """Of every word of every choice, as the others stand. Raises SrlError: this version can't read the profile."""
    profile.parse(label, text, (), Files(folder))
    choices = yaml_text.load(text, "rt").get("choices")
    words = [f"{name}={word}" for name, of in (choices or {}).items() for word in of if isinstance(of, dict)]
    found: Names = {}
    for override in ([], *([word] for word in words)):
        checked, source = profile.parse(label, text, override, Files(folder))
        graph = wiring.build(checked, source, [])
        for place, new in old_names(graph).items():
            found[written(place, source.moved)] = new
    return found


def _renamed(text: str, names: Names) -> tuple[str, list[tuple[int, str]]]:
    """The text with the new names, all else as it was; and the line of each that is renamed."""
    lines, done = text.splitlines(keepends=True), []
    tree = yaml_text.load(text, "rt")
    places = [(*at, place) for place in names if (at := _at(tree, place)) is not None]
    for row, column, place in sorted(places, reverse=True):  # from the last on: the columns before stay as they are
        old = place.rpartition(".")[2]
        if (quote := lines[row][column]) in "\"'":
            old = f"{quote}{old}{quote}"
        if lines[row].startswith(old, column):
            lines[row] = lines[row][:column] + names[place] + lines[row][column + len(old) :]
            done.append((row + 1, place))
    if any(each in names for each in tree.get("meant") or ()):
        raise ProfileError("meant", "it names an option by its old name", "Write the new one there first")
    return "".join(lines), done[::-1]


def _at(node: Any, place: str) -> tuple[int, int] | None:
    """Line and column, from 0, of a key in the text; None: it isn't written there itself."""
    *way, last = place.split(".")
    for word in way:
        if isinstance(node, CommentedSeq) and word.isdigit() and int(word) < len(node):
            node = node[int(word)]
        elif isinstance(node, CommentedMap) and word in node:
            node = node[word]
        else:
            return None
    try:
        line, column = node.lc.key(last)
    except (KeyError, TypeError, AttributeError):
        return None
    return int(line), int(column)
