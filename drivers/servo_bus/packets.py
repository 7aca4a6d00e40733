"""The packets of both protocols: instructions to servos, and their status answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

BROADCAST: Final = 0xFE
HIGHEST_ID: Final = 252  # the highest id that both protocols allow


@dataclass(frozen=True, slots=True)
class Instruction:
    """An instruction from the host: target id, code, and parameters (unstuffed)."""

    id: int
    code: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Status:
    """A servo's answer.

    Attributes:
        id: the servo that answers.
        error: protocol 2: the low seven bits, 0 for no error; protocol 1: all error bits.
        alert: protocol 2: the servo's hardware error status isn't 0.
        data: the data read, unstuffed; empty for an acknowledgement.
    """

    id: int
    error: int
    alert: bool
    data: bytes


class Counts:
    """A parser's counts.

    Attributes:
        frames: packets with a good checksum.
        errors: packets discarded: checksum, impossible length, cut short.
        resyncs: runs of bytes skipped in search of a header.
        skipped: bytes skipped in these runs.
    """

    def __init__(self) -> None:
        self.frames = self.errors = self.resyncs = self.skipped = 0
