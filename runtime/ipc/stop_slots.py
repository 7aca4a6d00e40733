"""The newest stop frames of each actuator. The loop stores them where the supervisor finds them after its death.

A slot has two buffers. The loop fills the idle one and then marks it as valid, so a death in between leaves the
older frames whole, and until when they may be written. Slot: int64 valid (0: none, 1 or 2), then twice (int64 ns of
CLOCK_MONOTONIC until which they may be written, 0: always; int64 length; `FRAMES` bytes). In these each frame has its
length in front, two bytes.
"""

from __future__ import annotations

import mmap
import os
from pathlib import Path

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc import private_file

SLOTS = 64  # devices with commands; fixed, so that the supervisor can make and map the file before the loop starts
FRAMES = 2040  # bytes of all frames of a slot with their lengths; every buffer begins at a multiple of 8
_LENGTH = 2
_HEAD = 16
_BUFFER = _HEAD + FRAMES
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
        self._newest: list[tuple[bytes, ...] | None] = [None] * SLOTS
        self._until = [0] * SLOTS  # ns, of the newest
        self._number = [0] * SLOTS  # the buffer that holds the newest; 0: they were too long

    @classmethod
    def create(cls, path: Path) -> StopSlots:
        """Makes the file, empty, in place of an older one. Raises HostError if it can't."""
        try:
            private_file.replace(path, bytes(SLOTS * _SLOT))
        except OSError as error:
            problem = f"the stop frames can't be kept here: {error.strerror}"
            raise HostError(str(path), problem, "Make room there, or set SRL_RUNTIME_DIR") from None
        return cls(path)

    def write(self, slot: int, frames: tuple[bytes, ...], until: int = 0) -> bool:
        """Stores the frames of an actuator. This costs little if they are the same object as before.

        Args:
            slot: the actuator's.
            frames: see `Driver.stop_frames`.
            until: ns of CLOCK_MONOTONIC, after which they must not be written any more; 0: always.

        Returns:
            False if they are too long, once for each object: those before stay in force, for as long as they were.
        """
        if frames is self._newest[slot]:
            number = self._number[slot]
            if number and until != self._until[slot]:
                at = self._buffer(slot, number)
                self._map[at : at + 8] = until.to_bytes(8, "little")
                self._until[slot] = until
            return True
        limit = until.to_bytes(8, "little")
        self._newest[slot] = frames
        packed = b"".join(len(frame).to_bytes(_LENGTH, "little") + frame for frame in frames)
        if len(packed) > FRAMES:  # half of them would be worse than those before
            self._number[slot] = 0
            return False
        other = 2 if self._map[slot * _SLOT] == 1 else 1
        at = self._buffer(slot, other)
        self._map[at : at + _HEAD + len(packed)] = limit + len(packed).to_bytes(8, "little") + packed
        self._map[slot * _SLOT] = self._number[slot] = other
        self._until[slot] = until
        return True

    def clear(self, slot: int) -> None:
        """Removes the frames, which were made for a lost connection."""
        self._newest[slot] = None
        self._map[slot * _SLOT] = 0

    def read(self, slot: int) -> list[bytes]:
        """Returns the newest whole frames; empty if there are none."""
        valid = self._map[slot * _SLOT]
        if valid not in (1, 2):
            return []
        at = self._buffer(slot, valid)
        length = int.from_bytes(self._map[at + 8 : at + _HEAD], "little")
        if length > FRAMES:  # damaged
            return []
        return _frames(self._map[at + _HEAD : at + _HEAD + length])

    def until(self, slot: int) -> int:
        """Returns the ns of CLOCK_MONOTONIC until which the frames may be written; 0: always, or there are none."""
        valid = self._map[slot * _SLOT]
        if valid not in (1, 2):
            return 0
        at = self._buffer(slot, valid)
        return int.from_bytes(self._map[at : at + 8], "little")

    @staticmethod
    def _buffer(slot: int, number: int) -> int:
        """Where buffer 1 or 2 of a slot begins."""
        return slot * _SLOT + 8 + (number - 1) * _BUFFER

    def close(self) -> None:
        """Unmaps the file."""
        self._map.close()


def _frames(packed: bytes) -> list[bytes]:
    """The frames of a buffer; none of a damaged one."""
    found = []
    while packed:
        length = int.from_bytes(packed[:_LENGTH], "little")
        frame, packed = packed[_LENGTH : _LENGTH + length], packed[_LENGTH + length :]
        if len(frame) < length:
            return []
        found.append(frame)
    return found
