"""The packets of both protocols: instructions to servos, their status answers, and how packets are found."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final

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


class PacketParser(ABC):
    """Finds packets in a stream of bytes, no matter how it is split; the same bytes give the same packets.

    Attributes:
        frames: packets with a good checksum.
        errors: packets discarded: checksum, impossible length, cut short.
        resyncs: runs of bytes skipped in search of a header.
        skipped: bytes skipped in these runs.
    """

    header: ClassVar[bytes]

    def __init__(self) -> None:
        self.frames = self.errors = self.resyncs = self.skipped = 0
        self._buffer = bytearray()
        self._searching = False

    @abstractmethod
    def _end(self, buffer: bytearray, start: int) -> int | None:
        """Returns where the packet that begins at `start` ends; None: that isn't known yet; 0: none begins there."""

    @abstractmethod
    def _packet(self, buffer: bytearray, start: int, end: int) -> tuple[int, bytes] | None:
        """Returns the id of a whole packet and what follows its length, without the checksum; None: that is wrong."""

    def forget(self) -> None:
        """Drops an incomplete packet: the rest of it won't come."""
        if self._buffer:
            self._buffer.clear()
            self.errors += 1
        self._searching = False

    def _packets(self, data: bytes) -> list[tuple[int, bytes]]:
        buffer, header = self._buffer, self.header
        buffer += data
        found: list[tuple[int, bytes]] = []
        at = 0
        while True:
            start = buffer.find(header, at)
            if start < 0:
                # The last bytes may be the first ones of a header.
                keep = next((k for k in range(len(header) - 1, 0, -1) if buffer.endswith(header[:k])), 0)
                start = max(at, len(buffer) - keep)
                self._skip(start - at)
                at = start
                break
            self._skip(start - at)
            at = start
            end = self._end(buffer, start)
            if end is None or end > len(buffer):
                break
            packet = self._packet(buffer, start, end) if end else None
            if packet is None:
                self.errors += end > 0
                self._skip(1)
                at = start + 1
                continue
            found.append(packet)
            self.frames += 1
            self._searching = False
            at = end
        del buffer[:at]
        return found

    def _skip(self, count: int) -> None:
        if count:
            self.skipped += count
            self.resyncs += not self._searching
            self._searching = True
