"""The command `srl`."""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import re
import sys
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from typing import NoReturn

from srl.runtime import __version__
from srl.runtime.contracts.errors import HostError, SrlError
from srl.runtime.contracts.printable import printable

COMMANDS = {
    "list": "lists drivers, controllers and profiles",
    "check": "checks a profile and prints its wiring, or all of it; as text or as a picture",
    "run": "runs a profile",
    "stop": "puts the limb into its safe stop",
    "reset": "lets a stopped limb move again, from where it is",
    "start": "lets a limb that is ready move (one without feedback begins at its home)",
    "set": "lists the live parameters of a running instance, or changes one",
    "twin": "opens the wire-level twins and prints their addresses",
    "replay": "replays a recording and compares the commands",
    "recordings": "lists the recordings of a folder; opens, exports, deletes them",
    "export": "writes a recording as a file of other programs, or as pictures",
    "top": "live view of a running instance",
    "panel": "a running instance in the browser: the operator's panel, or the participant's screen",
    "lsl": "sends a running instance's signals to a lab's recorder (Lab Streaming Layer)",
    "keys": "makes certificates for the bus over the network: the service's, and clients' with their roles",
    "doctor": "says whether this host is fit, and what mends it",
}
"""What each command of the service does, in one line. It stands here so that `srl --help` imports no command.

Others come by the entry points `srl.commands`, from this package and from anyone's: a module of little weight with such
a table, `COMMANDS`, and `add_parser(subparsers, name)`, which is called for the command that is asked for.
"""
MODULES = {name: name for name in COMMANDS} | {"reset": "stop", "start": "stop"}
"""In which module each of these commands is."""


class _Parser(argparse.ArgumentParser):
    """Says, too, what was probably meant."""

    def error(self, message: str) -> NoReturn:
        from srl.runtime.contracts.errors import nearest

        hint = f"`{self.prog} --help` lists what there is"
        words = message.rpartition(": ")[2].split()
        if message.startswith("unrecognized") and words[0].startswith("--"):
            hint = nearest(words[0].partition("=")[0], [o for o in self._option_string_actions if o.startswith("--")])
        elif "arguments are required" in message and "profile" in message and any("--sim" in w for w in sys.argv):
            hint = "Write the profile before --sim: what stands behind it are devices"
        elif found := re.search(r"invalid choice: '?([^']*)'? \(choose from (.*)\)", message):
            hint = nearest(found[1], [name.strip("' ") for name in found[2].split(",")])
            message = message.partition(" (choose from")[0]
        self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: {message}. {hint}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command. Returns 0 for success, 1 for an end in a fault, 2 for wrong input from the user,
    69 for a run whose device isn't there."""
    try:
        return _main(arguments)
    except KeyboardInterrupt:
        return 130  # by Ctrl-C, as a shell says it
    except HostError as error:  # a package whose command can't be used
        print(f"srl: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        from srl.runtime.contracts import extras

        if remedy := extras.remedy(error.name or ""):
            print(f"srl: this needs {error.name}, which isn't installed here. {remedy}", file=sys.stderr)
            return 2
        raise


def _main(arguments: Sequence[str] | None) -> int:
    if arguments is None:  # this process and its children: importing MuJoCo with its windows takes 0.2 s of each
        os.environ.setdefault("MUJOCO_GL", "disabled")
    parser: argparse.ArgumentParser = _Parser(
        prog="srl", description="Runtime for supernumerary robotic limbs.",
        epilog="Start with: srl run sixth-finger --sim", formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"srl-runtime {__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    given = _renamed(sys.argv[1:] if arguments is None else arguments)
    completing = "_ARGCOMPLETE" in os.environ  # a shell asks what could come next (docs/deployment.md)
    _add_commands(subparsers, os.environ.get("COMP_LINE", "").split()[1:] if completing else given)
    if completing:
        from srl.runtime.cli import completion

        completion.answer(parser)
    args, unknown = parser.parse_known_args(given)
    if unknown:
        subparsers.choices[args.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # as stderr: a file's name may be no UTF-8
    try:
        code = int(args.run(args))
        sys.stdout.flush()
        return code
    except SrlError as error:
        print(printable(_named(f"srl {args.command}", str(error))), file=sys.stderr)  # it may quote another's file
        return error.exit_code
    except BrokenPipeError:
        # The reader of the output has gone, so there is nobody to tell.
        _mute()
        return 0
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        _mute()
        print(f"srl {args.command}: there is no room left on the disk. Make room, then run it again", file=sys.stderr)
        return 2
    except Exception as error:
        from srl.runtime.contracts import code_file

        if (fault := code_file.fault(error)) is None:
            raise
        print(printable(f"srl {args.command}: {fault}"), file=sys.stderr)
        return 2


def _renamed(given: Sequence[str]) -> Sequence[str]:
    """The arguments with a command's new name, which is said; the next version knows only that."""
    if not given or given[0] != "show":
        return given
    parts = ("--all", "--devices", "--wiring", "--frames")
    part = any(part.startswith(word) for word in given if len(word) > 2 for part in parts)
    now = ["check", *given[1:], *([] if part else ["--all"])]
    print(f"srl show is called `srl {' '.join(now)}` now; the next version knows only that", file=sys.stderr)
    return now


def _named(command: str, error: str) -> str:
    """The error after the command's name, which stands once where the error's place begins with it."""
    return error if error.startswith((f"{command}:", f"{command} ")) else f"{command}: {error}"


def _mute() -> None:
    """Nothing goes to the output any more, also not when Python flushes it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _add_commands(subparsers: argparse._SubParsersAction[argparse.ArgumentParser], given: Sequence[str]) -> None:
    """Adds all commands. Only the module of the one that is asked for is imported: some take seconds to load."""
    asked = next((word for word in given if not word.startswith("-")), "")
    for name, text in COMMANDS.items():
        if name in subparsers.choices:
            continue  # by the module of another command
        if MODULES[name] == MODULES.get(asked):
            importlib.import_module(f"srl.runtime.cli.{MODULES[name]}").add_parser(subparsers)
        else:
            subparsers.add_parser(name, help=text)
    if asked in COMMANDS:
        return  # to look for others takes longer than to read the arguments
    from srl.runtime.cli import others

    for name, modules in others.commands().items():
        if name in COMMANDS:
            continue  # srl's own counts
        try:
            module = others.load(name, modules)
        except HostError as error:
            if name == asked:
                raise
            subparsers.add_parser(name, help=f"(can't be used: {error})".replace("%", "%%"))
            continue
        if name == asked:
            module.add_parser(subparsers, name)
        else:
            subparsers.add_parser(name, help=module.COMMANDS[name])


def add_command(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    example: str,
    commands: Mapping[str, str] = COMMANDS,
) -> argparse.ArgumentParser:
    """Adds a subcommand's parser with its line of help, from `commands`, and an example."""
    text = commands[name]
    return subparsers.add_parser(
        name, help=text, description=f"{text[0].upper()}{text[1:]}.", epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
