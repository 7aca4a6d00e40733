"""The supervisor's hold on the actuators: duplicates of their descriptors, and their stop frames, mapped.

After the loop's death nothing has to be opened: frames are read from memory and written to what is held.
"""

from __future__ import annotations

import errno
import os
import select
import time
from collections.abc import Callable
from dataclasses import dataclass

from srl.runtime.ipc.stop_slots import StopSlots

TIMEOUT = 0.2  # s in which the actuators must have taken their frames


@dataclass
class _Held:
    name: str
    descriptor: int


class Actuators:
    """The actuators of one run; see the module's docstring."""

    def __init__(self, slots: StopSlots, report: Callable[[str], None]) -> None:
        """`slots`: the mapped stop frames. `report` takes a line of text."""
        self._slots, self._report = slots, report
        self._held: dict[int, _Held] = {}
        self._settled: set[int] = set()  # slots that have taken a whole frame, or whose failure was reported

    def hold(self, slot: int, name: str, descriptor: int) -> None:
        """Takes over an actuator's descriptor, in place of an older one. Writing to it must never block."""
        self.drop(slot)
        self._settled.discard(slot)
        os.set_blocking(descriptor, False)
        self._held[slot] = _Held(name, descriptor)

    def drop(self, slot: int) -> None:
        """Closes an actuator's descriptor, if it is held."""
        if slot in self._held:
            os.close(self._held.pop(slot).descriptor)

    def stop(self) -> None:
        """Writes every actuator's stop frames, each by a write of its own.

        Each is tried once before any is waited for: one that takes nothing delays no other. Those with a rest are
        then tried in turn. Frames that are older than their driver allows are left out, and that is said: the device
        may have let go since, and would be pulled back. May be called again: frames that were written twice are the
        same stop. What went wrong is reported at the end, once for each actuator; the second frame of one that has
        taken the first may be refused.
        """
        deadline = time.monotonic() + TIMEOUT
        failures: dict[int, str] = {}
        rest = {slot: self._slots.read(slot) for slot in self._held if not self._old(slot)}
        while rest := self._give(rest, failures):
            if (left := deadline - time.monotonic()) <= 0:
                failures |= dict.fromkeys(rest, f"it took no bytes for {TIMEOUT:g} s")
                break
            poll = select.poll()  # not `select`: a descriptor may be above 1023
            for slot in rest:
                poll.register(self._held[slot].descriptor, select.POLLOUT)
            poll.poll(min(left * 1e3, 10))
        for slot, why in failures.items():
            if slot in self._settled:
                continue
            self._report(f"'{self._held[slot].name}' can't be reached for its stop: {why}")
        self._settled = set(self._held)

    def _old(self, slot: int) -> bool:
        until = self._slots.until(slot)
        if not until or time.monotonic_ns() <= until:
            return False
        if slot not in self._settled:
            self._report(
                f"'{self._held[slot].name}' gets no stop frame: it would be pulled back to where it was if it has let "
                "go since. It goes on with its last command, or does what it does in silence"
            )
        return True

    def _give(self, frames: dict[int, list[bytes]], failures: dict[int, str]) -> dict[int, list[bytes]]:
        """Writes what can be written at once. Returns what is left of each actuator's frames, if anything is."""
        rest = {}
        for slot, waiting in frames.items():
            try:
                left = _written(self._held[slot].descriptor, waiting)
            except OSError as error:
                failures[slot] = error.strerror or str(error)
                continue
            if left:
                rest[slot] = left
        return rest

    def close(self) -> None:
        """Closes all descriptors."""
        for slot in list(self._held):
            self.drop(slot)


def _written(descriptor: int, frames: list[bytes]) -> list[bytes]:
    """Writes frames until the descriptor takes no more. Returns the rest, from where it was cut."""
    for i, frame in enumerate(frames):
        try:
            count = os.write(descriptor, frame) if frame else 0
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.ENOBUFS):  # the second is a CAN interface whose queue is full
                return frames[i:]
            raise
        if count < len(frame):
            return [frame[count:], *frames[i + 1 :]]
    return []
