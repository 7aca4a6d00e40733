"""What `srl new` asks on a terminal: which profile to begin as, and at which port each device is."""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Mapping, Sequence

from runtime.cli.find_port import likely
from runtime.cli.printable import printable
from runtime.contracts.errors import RequestError, nearest
from runtime.profile import profile, shelf
from runtime.profile.ports import local_path
from runtime.service import serial_ports
from runtime.service.serial_ports import SerialPort


def template(name: str) -> str:
    """Asks for a shipped profile. Raises RequestError: nobody can answer, or no answer came."""
    names = shelf.shipped()
    if not _terminal():
        problem = "it isn't said what the new profile begins as"
        raise RequestError("--from", problem, f"For example srl new {name} --from sixth-finger. {nearest('', names)}")
    print("Profiles that come with srl:")
    for i, each in enumerate(names, 1):
        print(f"  {i:2} {each:<18} {shelf.summary(each) or profile.load(each)[0].summary}")
    while True:
        answer = _ask("Which is nearest to yours? Number or name: ")
        if _is_number(answer) and 1 <= int(answer) <= len(names):
            return names[int(answer) - 1]
        if answer in names:
            return answer
        print(printable(f"'{answer}' is none of them") if answer else "one is needed")


def ports(template: str, overrides: Sequence[str], told: Collection[str]) -> list[str]:
    """Asks for the port of each device that has one in the profile, but those that are `told`: as for `--port`."""
    chosen: dict[str, str] = {}
    found = serial_ports.ports()
    for device, entry in profile.load(template, overrides)[0].devices.items():
        given = entry.options.get("port")
        if given is None or device in told:
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
