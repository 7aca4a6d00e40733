"""The text of URScript programs: whole programs out of a stream of bytes, and the statements of a program."""

from __future__ import annotations

import re
from typing import Final

from srl.sim.devices.ur.twin_expressions import tokens

_PROGRAM: Final = re.compile(r"(?:def|sec)\s+(\w+)\s*\(")
_OPENS: Final = re.compile(r"\s*(?:def|sec|thread|while|for|if|struct)\b")
_CLOSES: Final = re.compile(r"\s*end\b")


class Programs:
    """Splits the bytes of a script port into whole programs: a `def` or `sec` up to its `end`, or a single line.

    Attributes:
        too_long: number of bytes discarded because they exceed the greatest length of a program.
    """

    LONGEST: Final = 200_000

    def __init__(self) -> None:
        self._rest = ""
        self._lines: list[str] = []
        self._size = 0
        self._depth = 0
        self.too_long = 0

    def feed(self, data: bytes) -> list[str]:
        """Takes bytes as they arrive; returns the programs that they complete."""
        *lines, self._rest = (self._rest + data.decode("latin-1")).split("\n")
        found = []
        for line in lines:
            if not self._lines and (not line.strip() or line.lstrip().startswith("#")):
                continue
            self._lines.append(line)
            self._size += len(line) + 1
            self._depth += bool(_OPENS.match(line)) - bool(_CLOSES.match(line))
            if self._depth <= 0:
                found.append("\n".join(self._lines) + "\n")
                self._forget()
        if self._size + len(self._rest) > self.LONGEST:
            self.too_long += self._size + len(self._rest)
            self._rest = ""
            self._forget()
        return found

    def _forget(self) -> None:
        self._lines, self._size, self._depth = [], 0, 0


def name_of(program: str) -> str:
    """A program's name; "" for a single line."""
    found = _PROGRAM.match(program.lstrip())
    return found[1] if found else ""


def statements(text: str) -> list[tuple[int, list[tuple[str, str]]]]:
    """The tokens of each statement, with its line's number.

    The language doesn't end a statement with its line: a number may stand on the line below its `=`, and `global`
    begins another statement on the same line.
    """
    found: list[tuple[int, list[tuple[str, str]]]] = []
    for number, line in enumerate(text.split("\n"), 1):
        words = tokens(line, number)
        goes_on = found and found[-1][1][-1][1] == "=" and words and words[0][0] != "name"
        statement = found.pop()[1] if goes_on else []
        for token in words:
            if token == ("name", "global") and statement:
                found.append((number, statement))
                statement = []
            statement.append(token)
        if statement:
            found.append((number, statement))
    return found
