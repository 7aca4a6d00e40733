"""The dashboard protocol: lines of text in both directions. Source: protocol sheet ur-rtde, section 4."""

from __future__ import annotations

import re
from typing import Final

from srl.drivers.ur.dial import Dial
from srl.drivers.ur.steps import Clock, Steps, until
from srl.runtime.contracts.errors import DeviceError

GREETING: Final = "Connected: Universal Robots Dashboard Server"
UNKNOWN: Final = "could not understand"
_LONGEST: Final = 4096  # bytes of a line
_ANSWER: Final = 3.0  # s
_VERSION: Final = re.compile(r"(\d+)\.(\d+)(?:\.(\d+))?")


class Lines:
    """Splits bytes into lines without their ends; keeps at most one incomplete line, and 4 KB of it."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[str]:
        """Takes bytes as they come; returns the lines they complete."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[:_LONGEST]
        return [line[:_LONGEST].decode("utf-8", "replace").strip() for line in lines]


class Dashboard:
    """One connection to the dashboard; commands are sent one after another."""

    def __init__(self, dial: Dial, clock: Clock) -> None:
        self._dial, self._clock = dial, clock
        self._lines = Lines()
        self._heard: list[str] = []

    def greet(self) -> Steps[None]:
        """Waits for the connection and the greeting. Raises DeviceError if there is no dashboard."""
        dial = self._dial
        if not (yield from until(dial.connected, self._clock, _ANSWER)):
            raise DeviceError(dial.place, f"the {dial.door} doesn't answer", "Check the network and the address")
        line = yield from self._line("its greeting")
        if "Universal Robots" not in line:
            raise DeviceError(
                dial.place,
                f"expected the greeting of a Universal Robots dashboard at {dial.door}, got '{line[:60]}'",
                "Correct 'port'; PolyScope X has no dashboard and isn't supported",
            )

    def ask(self, command: str) -> Steps[str]:
        """Returns the answer to one command. Raises DeviceError if none came."""
        self._heard.clear()
        rest = command.encode() + b"\n"
        while rest := self._dial.send(rest):
            yield
        return (yield from self._line(f"an answer to '{command}'"))

    def close(self) -> None:
        """Closes the connection. Always succeeds."""
        self._dial.close()

    def _line(self, what: str) -> Steps[str]:
        if not (yield from until(self._arrived, self._clock, _ANSWER)):
            raise DeviceError(
                self._dial.place,
                f"the {self._dial.door} didn't give {what} in {_ANSWER:g} s",
                "Check 'port'; restart the controller",
            )
        return self._heard.pop(0)

    def _arrived(self) -> bool:
        if not self._heard:
            self._heard += [line for line in self._lines.feed(self._dial.read()) if line]
        return bool(self._heard)


def understood(answer: str) -> bool:
    """Returns whether the controller knows the command that it answers."""
    return not answer.lower().startswith(UNKNOWN)


def value(answer: str) -> str:
    """Returns the text after the colon: RUNNING of `Robotmode: RUNNING`; the whole text if there is no colon."""
    return answer.partition(":")[2].strip() if ":" in answer else answer.strip()


def version(answer: str) -> tuple[int, int, int]:
    """Returns (5, 11, 0) for `URSoftware 5.11.0.108249 (Apr 22 2021)`; zeros where there is no number."""
    found = _VERSION.search(answer)
    return (int(found[1]), int(found[2]), int(found[3] or 0)) if found else (0, 0, 0)
