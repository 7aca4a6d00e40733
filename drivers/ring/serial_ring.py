"""Lines of a self-made ring on a serial port (sheet gamepad_f310_and_ring, C3). No I/O.

B1, B0         pressed, released
H<b> <ms>      every 100 ms: the level, and the ring's clock, which wraps at 2**32
V ring1 1      the identity, requested by `?`
"""

from __future__ import annotations

from typing import Final, NamedTuple

BAUDRATE: Final = 115200
ASK: Final = b"?"
LONGEST: Final = 32  # bytes of a line


class Line(NamedTuple):
    """One line: `kind` is b"B", b"H" or b"V"; `clock` is the ring's ms, -1 if the line has none."""

    kind: bytes
    level: float = 0.0
    clock: int = -1


class Parser:
    """Cuts bytes into lines.

    Attributes:
        frames, errors: lines of a known form, and other lines.
    """

    def __init__(self) -> None:
        self.frames = self.errors = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[Line]:
        """Returns the lines that `data` completes, oldest first."""
        *lines, rest = (self._rest + data).split(b"\n")
        if len(rest) > LONGEST:
            self.errors += 1
            rest = b"\0"  # so that the end of a line that is too long doesn't count as a line, either
        self._rest = rest
        found = []
        for text in lines:
            line = _parse(text.removesuffix(b"\r"))
            if line is None:
                self.errors += 1
            else:
                self.frames += 1
                found.append(line)
        return found


def _parse(text: bytes) -> Line | None:
    if text in (b"B0", b"B1"):
        return Line(b"B", float(text == b"B1"))
    if text[:3] in (b"H0 ", b"H1 ") and text[3:].isdigit() and len(text) <= 13 and (clock := int(text[3:])) < 1 << 32:
        return Line(b"H", float(text[1:2] == b"1"), clock)
    return Line(b"V") if text == b"V ring1 1" else None
