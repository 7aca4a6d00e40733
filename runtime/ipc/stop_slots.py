"""The newest stop frame of each actuator. The loop stores it where the supervisor finds it after the loop's death.

A slot has two buffers. The loop fills the idle one and then marks it as valid, so a death in between leaves the
older frame whole. Slot: int64 valid (0: none, 1 or 2), then twice (int64 length, `FRAME` bytes).
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path

from runtime.contracts.errors import HostError
from runtime.ipc import private_file

SLOTS = 64  # devices with commands; fixed, so that the supervisor can make and map the file before the loop starts
FRAME = 496
_BUFFER = 8 + FRAME
_SLOT = 8 + 2 * _BUFFER


class StopSlots:
    """The file with the actuators' stop frames; see the module's docstring."""

    def __init__(self, path: Path) -> None:
        """Maps the file.

        Raises:
            HostError: it isn't there, or it is damaged.
        """
        remedy = "Start the run again with `srl run`: it makes a new one"
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise HostError(str(path), f"the stop frames can't be opened: {error.strerror}", remedy) from None
        try:
            size = os.fstat(descriptor).st_size
            if size != SLOTS * _SLOT:
                problem = f"the file of the stop frames is damaged: {size} bytes, not {SLOTS * _SLOT}"
                raise HostError(str(path), problem, remedy)
            self._map = mmap.mmap(descriptor, size)
        finally:
            os.close(descriptor)
        self._newest: list[bytes | None] = [None] * SLOTS

    @classmethod
    def create(cls, path: Path) -> StopSlots:
        """Makes the file, empty, in place of an older one. Raises HostError if it can't."""
        try:
            private_file.replace(path, bytes(SLOTS * _SLOT))
        except OSError as error:
            problem = f"the stop frames can't be kept here: {error.strerror}"
            raise HostError(str(path), problem, "Make room there, or set SRL_RUNTIME_DIR") from None
        return cls(path)

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
        if valid not in (1, 2):
            return b""
        at = start + 8 + (valid - 1) * _BUFFER
        length = int.from_bytes(self._map[at : at + 8], "little")
        if length > FRAME:  # damaged
            return b""
        return self._map[at + 8 : at + 8 + length]

    def close(self) -> None:
        """Unmaps the file."""
        self._map.close()
