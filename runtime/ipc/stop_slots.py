"""The newest stop frame of each actuator. The loop stores it where the supervisor finds it after the loop's death.

A slot has two buffers. The loop fills the idle one and then marks it as valid, so a death in between leaves the
older frame whole. Slot: int64 valid (0: none, 1 or 2), then twice (int64 length, `FRAME` bytes).
"""

from __future__ import annotations

import mmap
from pathlib import Path

FRAME = 496
_BUFFER = 8 + FRAME
_SLOT = 8 + 2 * _BUFFER


class StopSlots:
    """The file with the actuators' stop frames; see the module's docstring."""

    def __init__(self, path: Path, count: int, create: bool = False) -> None:
        if create:
            path.write_bytes(bytes(max(count, 1) * _SLOT))
        with open(path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self._newest: list[bytes | None] = [None] * count

    def write(self, slot: int, frame: bytes) -> None:
        """Stores a frame. This costs nothing if it is the same object as before."""
        if frame is self._newest[slot]:
            return
        self._newest[slot] = frame
        if len(frame) > FRAME:  # half a frame would be worse than the one before
            return
        start = slot * _SLOT
        other = 2 if self._map[start] == 1 else 1
        at = start + 8 + (other - 1) * _BUFFER
        self._map[at : at + 8 + len(frame)] = len(frame).to_bytes(8, "little") + frame
        self._map[start] = other

    def clear(self, slot: int) -> None:
        """Removes the frame, which was made for a lost connection."""
        self._newest[slot] = None
        self._map[slot * _SLOT] = 0

    def read(self, slot: int) -> bytes:
        """Returns the newest whole frame; empty if there is none."""
        start = slot * _SLOT
        valid = self._map[start]
        if valid == 0:
            return b""
        at = start + 8 + (valid - 1) * _BUFFER
        length = int.from_bytes(self._map[at : at + 8], "little")
        return self._map[at + 8 : at + 8 + length]

    def close(self) -> None:
        """Unmaps the file."""
        self._map.close()
