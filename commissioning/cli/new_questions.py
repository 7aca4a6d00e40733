"""What `srl new` asks on a terminal: which profile to begin as, what moves a limb, at which port each device is."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from srl.commissioning.cli.find_port import likely
from srl.commissioning.new.limb_drivers import limb_drivers
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.limb_drives import Question
from srl.runtime.contracts.printable import printable
from srl.runtime.profile import library, profile
from srl.runtime.profile.ports import local_path
from srl.runtime.service import serial_ports
from srl.runtime.service.serial_ports import SerialPort


def template(name: str) -> str:
    """Asks for a shipped profile. Raises RequestError: nobody can answer, or no answer came."""
    names = library.shipped()
    if not _terminal():
        problem = "it isn't said what the new profile begins as"
        raise RequestError("--from", problem, f"For example srl new {name} --from sixth-finger. {nearest('', names)}")
    print("Profiles that come with srl:")
    return _one_of(
        {each: library.summary(each) or profile.load(each)[0].summary for each in names},
        "Which is nearest to yours? Number or name: ",
    )


def driver(name: str) -> str:
    """Asks for the driver of a limb from its URDF. Raises RequestError: nobody can answer, or no answer came."""
    if not _terminal():
        problem = "it isn't said what moves the limb's joints"
        raise RequestError("--driver", problem, f"For example srl new {name} --urdf FILE --driver feetech. "
                           f"{nearest('', limb_drivers())}")  # fmt: skip
    print("What moves the limb's joints:")
    return _one_of({each: kind.words for each, kind in limb_drivers().items()}, "Which is yours? Number or name: ")


def option(place: str, setting: str, asked: Question, meaning: Callable[[str], Any]) -> Any:
    """Asks for an option that can't be guessed, and returns what the answer means.

    Args:
        place: of the error where nobody can answer, or no answer came.
        setting: how it is said on the command line, up to the value.
        asked: the question.
        meaning: of an answer; raises ValueError, for people.
    """
    choices = " or ".join(asked.answers) or asked.example
    if not _terminal():
        raise RequestError(place, f"it isn't said {asked.what}", f"Add {setting}{asked.example} ({choices})")
    while True:
        try:
            return meaning(_ask(f"{asked.what[0].upper()}{asked.what[1:]}? {_hint(asked)}: "))
        except ValueError as error:
            print(printable(str(error)))


def _hint(asked: Question) -> str:
    return "Yes or no" if asked.kind == "yes" else " or ".join(asked.answers) or f"For example {asked.example}"


def _one_of(words: Mapping[str, str], question: str) -> str:
    """Shows names with what they are, and asks for one."""
    names = list(words)
    for i, each in enumerate(names, 1):
        print(f"  {i:2} {each:<18} {words[each]}")
    while True:
        answer = _ask(question)
        if _is_number(answer) and 1 <= int(answer) <= len(names):
            return names[int(answer) - 1]
        if answer in names:
            return answer
        print(printable(f"'{answer}' is none of them") if answer else "one is needed")


def ports(template: str, overrides: Sequence[str], named: Collection[str]) -> list[str]:
    """Asks for the port of each device that has one in the profile, but those that are `named`: as for `--port`."""
    chosen: dict[str, str] = {}
    found = serial_ports.ports()
    for device, entry in profile.load(template, overrides)[0].devices.items():
        given = entry.options.get("port")
        if given is None or device in named:
            continue
        local = local_path(str(given)) is not None
        if local and found:
            print("Ports of this machine:")
            for i, port in enumerate(found, 1):
                print(printable(f"  {i:2} {port.path}: {likely(port)}{_taken(port, chosen)}"))
        what = "An address" if not local else "Number, a path" if found else "A path"
        while True:
            answer = _ask(f"Port of {device} ({entry.driver})? {what}, or Enter for {given}: ")
            if not answer:
                break
            if local and _is_number(answer) and 1 <= int(answer) <= len(found):
                answer = found[int(answer) - 1].path
            if _is_number(answer):
                print(f"there is no port number {answer}")
            elif not answer.isprintable() or (local and local_path(answer) is None and "://" not in answer):
                print(f"{answer!r} is no path")
            elif local and (owner := _owner(answer, chosen)) is not None:
                print(f"it is {owner}'s already")
            else:
                chosen[device] = answer
                break
    return [f"{device}={port}" for device, port in chosen.items()]


def _is_number(answer: str) -> bool:
    return answer.isascii() and answer.isdigit()


def _owner(port: str, chosen: Mapping[str, str]) -> str | None:
    """The device that has this port already, by whatever name of it."""
    return next((name for name, path in chosen.items() if os.path.realpath(path) == os.path.realpath(port)), None)


def _taken(port: SerialPort, chosen: Mapping[str, str]) -> str:
    owner = _owner(port.path, chosen)
    words = [f"{port.holder} has it open"] * (port.holder is not None) + [f"it is {owner}'s"] * (owner is not None)
    return "".join(f", {each}" for each in words)


def _terminal() -> bool:
    return sys.stdin is not None and not sys.stdin.closed and sys.stdin.isatty() and sys.stdout.isatty()


def _ask(question: str) -> str:
    try:
        return input(question).strip()
    except EOFError:
        raise RequestError(
            "srl new", "no answer came, and nothing was written", "Begin again, or give --from"
        ) from None
