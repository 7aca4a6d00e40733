"""Options and arguments that several commands take: one name, one meaning, one line of help each."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import RequestError, nearest

PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".pdf", ".svg", ".eps")


def profile(parser: argparse.ArgumentParser, needed: bool = True, text: str = "") -> None:
    """The profile, by its name or its file."""
    what = text or "a name under profiles/, or a path to a YAML file"
    parser.add_argument("profile", nargs=None if needed else "?", help=what)


def sim(parser: argparse.ArgumentParser, text: str = "simulate these devices; without a name, all") -> None:
    """Which devices are simulated: None for none of them, [] for all."""
    parser.add_argument("--sim", nargs="*", metavar="DEVICE", help=text)


def overrides(parser: argparse.ArgumentParser, text: str = "override a key of the profile") -> None:
    """What of the profile is changed for this time."""
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=text)


def name(parser: argparse.ArgumentParser) -> None:
    """The name of the instance that the command starts."""
    parser.add_argument("--instance", metavar="NAME", help="name of this instance; default: the profile's")


def instance(parser: argparse.ArgumentParser) -> None:
    """The running instance that the command is for."""
    parser.add_argument("instance", nargs="?", help="its name; default: the only one that runs")


def confirm(parser: argparse.ArgumentParser) -> None:
    """That somebody has looked where the limb stands."""
    parser.add_argument(
        "--confirm", action="store_true",
        help="devices without feedback stand where the profile says (home), nothing is in their way",
    )  # fmt: skip


def wearer(parser: argparse.ArgumentParser) -> None:
    """What the simulated person does."""
    parser.add_argument("--wearer", metavar="FILE", help="the simulated person repeats this recording")


def check_person(person: str | None) -> None:
    """Raises RequestError: an id could be a name. None is none."""
    from srl.runtime.ipc.launch import ANONYMOUS

    if person is not None and not re.fullmatch(ANONYMOUS, person):
        problem = f"'{person}' isn't anonymous: up to four letters, then a number"
        raise RequestError("--person", problem, "Number the persons, P07, and keep their names elsewhere")


def figure(parser: argparse.ArgumentParser, text: str) -> None:
    """A picture with axes."""
    parser.add_argument("--figure", type=Path, metavar="FILE.png", help=text)


def check_figure(path: Path | None) -> None:
    """Raises RequestError: it isn't named as a picture, or can't be made here. None is none."""
    if path is None:
        return
    if find_spec("matplotlib") is None:  # else it would fail after the run
        raise RequestError("--figure", "this needs matplotlib, which isn't installed here", extras.remedy("matplotlib"))
    if not path.absolute().parent.is_dir():
        raise RequestError("--figure", f"there is no folder {path.parent}", "Make it first")
    if path.suffix.lower() not in PICTURES:
        raise RequestError("--figure", f"'{path.name}' isn't named as a picture", "Name it like run.png")


def recording(parser: argparse.ArgumentParser) -> None:
    """A recording, or what is left of one."""
    parser.add_argument("recording", type=Path, help="FILE.rrd, or a folder of segments (a torn tail is salvaged)")


def run_code(parser: argparse.ArgumentParser, default: bool) -> None:
    """Whether code that a profile names, or that a recording holds, is run."""
    parser.add_argument(
        "--run-code", action=argparse.BooleanOptionalAction, default=default,
        help="run the code in files that the profile names, as you would run any program; that of a recording isn't "
        "run without this",
    )  # fmt: skip


def as_json(parser: argparse.ArgumentParser, text: str = "one JSON object") -> None:
    """Output for programs."""
    parser.add_argument("--json", action="store_true", help=text)


def simulated(sim: Sequence[str] | None, devices: Sequence[str], label: str) -> list[str] | None:
    """The devices that `--sim` names, each once; all for an empty list. Raises RequestError: there is no such one."""
    if sim is None:
        return None
    for device in sim:
        if device not in devices:
            raise RequestError(f"--sim {device}", f"{label} has no device '{device}'", nearest(device, devices))
    return list(dict.fromkeys(sim)) or list(devices)


class _Renamed(argparse.Action):
    """An option's old spelling: it does what the new one does, and says so."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        print(f"{parser.prog}: {option} is called {self.const} now; the next version knows only that", file=sys.stderr)
        parser._option_string_actions[self.const](parser, namespace, values, self.const)


def renamed(parser: argparse.ArgumentParser, old: str, new: str) -> None:
    """Still takes the old spelling of an option that the parser has by its new name. It isn't in the help."""
    now = parser._option_string_actions[new]
    parser.add_argument(
        old, action=_Renamed, dest=now.dest, const=new, nargs=now.nargs, type=now.type or str, choices=now.choices,
        default=now.default, help=argparse.SUPPRESS,
    )  # fmt: skip
