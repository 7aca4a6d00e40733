"""What both protocols carry: instructions to servos, and their status answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

BROADCAST: Final = 0xFE
HIGHEST_ID: Final = 252  # the highest that both protocols allow


@dataclass(frozen=True, slots=True)
class Instruction:
    """What a host sends: to whom, what, and its parameters (unstuffed)."""

    id: int
    code: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Status:
    """What a servo answers.

    Attributes:
        id: who answers.
        error: protocol 2: the low seven bits, 0 where all is well; protocol 1: all error bits.
        alert: protocol 2: the servo's hardware error status isn't 0.
        data: what was read, unstuffed; empty for an acknowledgement.
    """

    id: int
    error: int
    alert: bool
    data: bytes


class Counts:
    """What a parser counts.

    Attributes:
        frames: packets with a good checksum.
        errors: packets thrown away: checksum, impossible length, cut short.
        resyncs: runs of bytes skipped in search of a header.
        skipped: bytes skipped so.
    """

    def __init__(self) -> None:
        self.frames = self.errors = self.resyncs = self.skipped = 0
