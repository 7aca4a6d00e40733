"""The command `srl`."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from runtime import __version__
from runtime.contracts.errors import SrlError

COMMANDS = ("list", "check", "run", "calibrate", "stop", "twin", "replay", "export", "study", "top", "panel", "doctor")
MODULES = {name: name for name in COMMANDS} | {"reset": "stop", "start": "stop"}
"""In which module each command is."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command. Returns 0 for success, 1 for an end in a fault, 2 for wrong input from the user."""
    try:
        return _main(arguments)
    except KeyboardInterrupt:
        return 130  # by Ctrl-C, as a shell says it


def _main(arguments: Sequence[str] | None) -> int:
    parser = argparse.ArgumentParser(
        prog="srl", description="Runtime for supernumerary robotic limbs.",
        epilog="Start with: srl run sixth-finger --sim", formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"srl-runtime {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    # What another command needs takes seconds to load: `srl stop` doesn't wait for it.
    asked = next(iter(sys.argv[1:] if arguments is None else arguments), "")
    for name in (MODULES[asked],) if asked in MODULES else COMMANDS:
        importlib.import_module(f"runtime.cli.{name}").add_parser(subparsers)
    args = parser.parse_args(arguments)
    try:
        return int(args.run(args))
    except SrlError as error:
        print(f"srl {args.command}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stderr.close()  # the reader of the output has gone, so there is nobody to inform
        return 0


def add_command(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser], name: str, text: str, example: str
) -> argparse.ArgumentParser:
    """Adds a subcommand's parser with one line of help and an example."""
    return subparsers.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
