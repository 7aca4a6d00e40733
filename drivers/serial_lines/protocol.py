"""Finds samples in the bytes of a serial line, and makes such bytes. No I/O."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import Final

from srl.drivers.serial_lines.config import SerialLinesConfig

LONGEST: Final = 4096  # bytes of a line; what is longer is none
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")


class Parser:
    """Takes any bytes; never raises.

    Attributes:
        errors: what was no sample: garbled, cut, too long, of another form, with a wrong checksum.
        why: of the newest of these.
        others: lines without the prefix.
    """

    def __init__(self, config: SerialLinesConfig) -> None:
        self._config = config
        self._rest = b""
        self._synced = False  # the first line may have started before we listened
        self.errors = self.others = 0
        self.why = ""

    def feed(self, data: bytes) -> list[list[float]]:
        """The samples that `data` completes, oldest first: the numbers of each."""
        self._rest += data
        return self._lines() if self._config.format == "text" else self._frames()

    def _lines(self) -> list[list[float]]:
        *lines, self._rest = self._rest.split(b"\n")
        if len(self._rest) > LONGEST:
            self._rest = b""
            self._bad("a line has no end")
        found = []
        for line in lines:
            try:
                sample = self._line(line.rstrip(b"\r"))
            except ValueError as error:
                self._bad(str(error))
            else:
                if sample is not None:
                    found.append(sample)
            self._synced = True
        return found

    def _line(self, line: bytes) -> list[float] | None:
        """Its numbers; None: it isn't looked at. Raises ValueError: why it is no sample."""
        config = self._config
        try:
            text = line.decode("ascii").strip()
        except UnicodeDecodeError:
            raise ValueError("a line isn't text: is the baud rate right?") from None
        if not text.startswith(config.prefix):
            self.others += 1
            return None
        if config.checksum != "none":
            text, star, given = text.rpartition("*")
            if (
                not star
                or not re.fullmatch("[0-9A-Fa-f]{2}", given)
                or int(given, 16) != self._sum(text.removeprefix("$").encode())
            ):
                raise ValueError("a checksum is wrong")
        body = text.removeprefix(config.prefix).strip()
        parts = body.split() if config.separator.isspace() else [p.strip() for p in body.split(config.separator)]
        if len(parts) != config.columns:
            raise ValueError(f"a line has {len(parts)} numbers, not {config.columns}")
        if not all(_NUMBER.fullmatch(part) for part in parts):
            raise ValueError("a line has something that is no number")
        if not self._synced and config.checksum == "none" and not config.prefix:
            return None  # its first number may have been cut
        return [float(part) for part in parts]

    def _frames(self) -> list[list[float]]:
        config, head, size = self._config, self._config.head, self._config.size
        found: list[list[float]] = []
        at = 0
        while (begin := self._rest.find(head, at)) >= 0 and begin + size <= len(self._rest):
            if begin > at:
                self._bad("bytes between frames")
            body = self._rest[begin + len(head) : begin + size]
            if config.checksum != "none":
                body, last = body[:-1], body[-1]
                if last != self._sum(body):
                    at = begin + 1
                    self._bad("a checksum is wrong")
                    continue
            at = begin + size
            found.append([float(x) for x in struct.unpack(config.fields, body)])
        if begin < 0 and len(self._rest) - at >= len(head):
            at = len(self._rest) - len(head) + 1
            self._bad("bytes between frames")
        self._rest = self._rest[at:]
        return found

    def _sum(self, data: bytes) -> int:
        return reduce(xor, data, 0) if self._config.checksum == "xor" else sum(data) & 0xFF

    def _bad(self, why: str) -> None:
        if self._synced or self._config.format == "binary":  # what started before we listened is no error
            self.errors += 1
            self.why = why


def encode(config: SerialLinesConfig, numbers: Sequence[float]) -> bytes:
    """The bytes of a sample of `columns` numbers."""
    if config.format == "binary":
        kinds = config.fields[1:]
        body = struct.pack(config.fields, *(n if k in "fd" else round(n) for k, n in zip(kinds, numbers, strict=True)))
        check = Parser(config)._sum(body) if config.checksum != "none" else None
        return config.head + body + (b"" if check is None else bytes((check,)))
    text = config.prefix + config.separator.join(f"{number:.10g}" for number in numbers)
    if config.checksum != "none":
        text += f"*{Parser(config)._sum(text.removeprefix('$').encode()):02X}"
    return text.encode() + b"\r\n"
