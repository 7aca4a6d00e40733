"""What `srl new` asks on a terminal: which profile to begin as, and at which port each device is."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence

from runtime.cli.find_port import likely
from runtime.contracts.errors import RequestError, nearest
from runtime.profile import profile, shelf
from runtime.service import serial_ports


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
        if answer.isdigit() and 1 <= int(answer) <= len(names):
            return names[int(answer) - 1]
        if answer in names:
            return answer
        print(f"'{answer}' is none of them" if answer else "one is needed")


def ports(template: str, overrides: Sequence[str], told: Collection[str]) -> list[str]:
    """Asks for the port of each device that has one in the profile, but those that are `told`: as for `--port`."""
    chosen = []
    found = serial_ports.ports()
    for device, entry in profile.load(template, overrides)[0].devices.items():
        given = entry.options.get("port")
        if given is None or device in told:
            continue
        local = str(given).startswith("/dev/") and bool(found)
        if local:
            print("Ports of this machine:")
            for i, port in enumerate(found, 1):
                print(f"  {i:2} {port.path}: {likely(port)}")
        what = "Number, a path" if local else "An address"
        while True:
            answer = _ask(f"Port of {device} ({entry.driver})? {what}, or Enter for {given}: ")
            if not answer:
                break
            if not answer.isdigit():
                chosen.append(f"{device}={answer}")
                break
            if local and 1 <= int(answer) <= len(found):
                chosen.append(f"{device}={found[int(answer) - 1].path}")
                break
            print(f"there is no port number {answer}")
    return chosen


def _terminal() -> bool:
    return sys.stdin is not None and not sys.stdin.closed and sys.stdin.isatty() and sys.stdout.isatty()


def _ask(question: str) -> str:
    try:
        return input(question).strip()
    except EOFError:
        raise RequestError(
            "srl new", "no answer came, and nothing was written", "Begin again, or give --from"
        ) from None
