"""The page docs/commands.md: each command's help, made of its parser. `make commands` writes it anew."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from srl.runtime.cli import COMMANDS, MODULES, others

PAGE: Final = "docs/commands.md"
HEAD: Final = (
    "# Commands\n\nThis page is what `srl COMMAND --help` says of each command. It is made of the commands themselves "
    "(`make commands`). An option has the same name and the same meaning in each command that has it.\n"
)


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each command of this package, by its name, in the order of `srl --help`."""
    subparsers = argparse.ArgumentParser(prog="srl").add_subparsers(metavar="COMMAND")
    for name in COMMANDS:
        if name not in subparsers.choices:
            importlib.import_module(f"srl.runtime.cli.{MODULES[name]}").add_parser(subparsers)
    for name, modules in others.commands().items():
        if name not in COMMANDS and modules[0].startswith("srl."):
            others.load(name, modules).add_parser(subparsers, name)
    order = [*COMMANDS, *sorted(subparsers.choices.keys() - COMMANDS.keys())]
    return {name: subparsers.choices[name] for name in order}


def arguments(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """What the parser takes, as the help has it."""
    return [a for a in parser._actions if a.help != argparse.SUPPRESS and not isinstance(a, argparse._HelpAction)]


def page() -> str:
    """The page's text."""
    found = parsers()
    links = (f"- [srl {name}](#srl-{name}): {_cell((p.description or '').rstrip('.'))}" for name, p in found.items())
    return "\n".join((HEAD, *links, *(line for name, parser in found.items() for line in _section(name, parser)), ""))


def _section(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    example = (parser.epilog or "").partition("example:\n")[2].strip()
    yield from ("", f"## srl {name}", "", parser.description or "")
    if example:
        yield from ("", "```", example, "```")
    if given := arguments(parser):
        yield from ("", "| | |", "| --- | --- |")
        yield from (f"| {_written(action)} | {_cell(action.help or '')} |" for action in given)


def _written(action: argparse.Action) -> str:
    """An argument as one types it."""
    if action.choices is not None and action.metavar is None:
        values = f"{{{','.join(map(str, action.choices))}}}"
    elif isinstance(action.metavar, tuple):
        values = " ".join(action.metavar)
    else:
        values = action.metavar or action.dest.upper()
    if not (action.option_strings and action.nargs == 0):
        many = {"?": f"[{values}]", "*": f"[{values} ...]", "+": f"{values} [{values} ...]"}
        values = many.get(str(action.nargs), values)
    else:
        values = ""
    return _cell(", ".join(f"`{' '.join(filter(None, (each, values)))}`" for each in action.option_strings or [""]))


def _cell(text: str) -> str:
    return " ".join(text.replace("%%", "%").replace("|", "\\|").split())


if __name__ == "__main__":
    Path(sys.argv[1] if len(sys.argv) > 1 else PAGE).write_text(page())
