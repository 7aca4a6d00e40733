"""`srl new NAME --urdf FILE`: a profile for a limb from its URDF, with motors chosen by its weight."""

from __future__ import annotations

import argparse
import os
import shlex
from functools import partial
from pathlib import Path
from typing import Any

from srl.commissioning.cli import new_ports, new_questions
from srl.commissioning.new.from_urdf import Limb
from srl.commissioning.new.limb_drivers import limb_driver
from srl.runtime.cli.check import examine
from srl.runtime.contracts import whole_file
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.limb_drives import LimbDrives, Question
from srl.runtime.contracts.printable import printable
from srl.runtime.ipc import older
from srl.runtime.profile.edit import edited
from srl.runtime.profile.overrides import split


def write(args: argparse.Namespace, target: Path, overrides: list[str]) -> int:
    """Writes the profile, checks it, and says what comes next. Returns 0; what is wrong is raised."""
    file = Path(args.urdf)
    drives = limb_driver(args.driver or new_questions.driver(args.name))
    answers, rest = _answers(drives, overrides, target.parent)
    limb = Limb(file, args.base, args.tip, drives, answers)
    started = str(edited(f"{args.name}.yaml", limb.profile(args.name, target.parent), rest))
    kept = older.keep(target)
    try:
        whole_file.write(target, started.encode(), RequestError)
        graph, _ = examine(str(target), sim=[])
        real, _ = examine(str(target))
    except BaseException:  # what `--set` says may be wrong; Ctrl-C
        target.unlink(missing_ok=True)
        if kept is not None:
            kept.replace(target)
        raise
    print(f"{target}: made of {file}" + f"; the one before is {kept}" * (kept is not None))
    warnings = [f"warning: {warning}" for warning in (*real.warnings, *graph.warnings)]
    for line in dict.fromkeys([*graph.remarks, *warnings, *limb.strained(), *new_ports.remarks(real)]):
        print(printable(f"  {line}"))
    more = f"; so are {drives.guessed}" * bool(drives.guessed)
    print(f"  ids, directions and zeros are guesses: jog each joint of the real limb before anything else{more}")
    print("Next:")
    name = shlex.quote(str(target))
    for line in (f"srl check {name}", f"srl jog {name} --sim", f"srl run {name} --sim --view", f"srl jog {name}"):
        print(f"  {line}")
    return 0


def _answers(drives: LimbDrives, overrides: list[str], folder: Path) -> tuple[dict[str, Any], list[str]]:
    """What only a person knows of the motors, said by overrides or asked for, and the overrides of the rest."""
    given = {path: text for path, text in map(split, overrides)}
    answers: dict[str, Any] = {}
    taken = set()
    while (asked := drives.asks(answers)) is not None:
        path = f"devices.arm.{asked.option}"
        if path in given:
            taken.add(path)
            answers[asked.option] = _answer(asked, path, given[path], folder)
        else:
            meaning = partial(_seen, asked, folder)
            place = f"--driver {drives.driver}"
            answers[asked.option] = new_questions.option(place, f"--set {path}=", asked, meaning)
    return answers, [override for override in overrides if split(override)[0] not in taken]


def _answer(asked: Question, path: str, text: str, folder: Path) -> Any:
    try:
        return _seen(asked, folder, text)
    except ValueError as error:
        raise RequestError(f"--set {path}={text}", f"it says {asked.what}", f"{error}") from None


def _seen(asked: Question, folder: Path, text: str) -> Any:
    """What an answer means; a path that was typed begins here, and one in the profile beside it."""
    value = asked.value(text)
    if asked.kind == "file":
        if not Path(value).expanduser().is_file():
            raise ValueError(f"There is no file {value}")
        return os.path.relpath(Path(value).expanduser().absolute(), folder.absolute())
    return value
