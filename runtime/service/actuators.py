"""The supervisor's hold on the actuators: duplicates of their descriptors, and their stop frames, mapped.

After the loop's death nothing has to be opened: a frame is read from memory and written to what is held.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable
from dataclasses import dataclass

from runtime.ipc.stop_slots import StopSlots

PATIENCE = 0.2  # s in which the actuators must have taken their frames


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
        """Writes every actuator's stop frame.

        Each is tried once before any is waited for: one that takes nothing delays no other. Those with a rest are
        then tried in turn. May be called again: a frame that was written twice is the same stop. What went wrong is
        reported at the end, once for each actuator; the second frame of one that has taken the first may be refused.
        """
        deadline = time.monotonic() + PATIENCE
        failures: dict[int, str] = {}
        rest = {slot: self._slots.read(slot) for slot in self._held}
        while rest := self._give(rest, failures):
            if (left := deadline - time.monotonic()) <= 0:
                failures |= dict.fromkeys(rest, f"it took no bytes for {PATIENCE:g} s")
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

    def _give(self, frames: dict[int, bytes], failures: dict[int, str]) -> dict[int, bytes]:
        """Writes what can be written at once. Returns the rest of each frame that has one."""
        rest = {}
        for slot, frame in frames.items():
            try:
                written = os.write(self._held[slot].descriptor, frame) if frame else 0
            except BlockingIOError:
                written = 0
            except OSError as error:
                failures[slot] = error.strerror or str(error)
                continue
            if written < len(frame):
                rest[slot] = frame[written:]
        return rest

    def close(self) -> None:
        """Closes all descriptors."""
        for slot in list(self._held):
            self.drop(slot)
