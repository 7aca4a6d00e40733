"""What each phase of a simulated cycle holds: the parts of the world, MuJoCo and the fakes are timed where they run.

The world advances in the clock's wait (`SimClock`), before the cycle's own phases.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

from bench.pairs import Row, measure
from srl.runtime.ipc.header import State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring

PHASES = ("wait", "read", "control", "guard", "write")
BLOCK = 200  # cycles of one measurement


class _Split:
    """A profile's cycle, step by step; MuJoCo's calls add their time to the phase in which they are made."""

    def __init__(self, name: str) -> None:
        checked, source = profile.load(name)
        graph = wiring.build(checked, source, [])
        self._lockstep = lockstep = Lockstep(graph)
        self._phase = ""
        self._whole = dict.fromkeys(PHASES, 0)
        self._inside = dict.fromkeys(PHASES, 0)
        assert graph.world is not None
        cycle: Any = lockstep.cycle
        self._within(graph.world, "advance", "wait")
        for device in lockstep.devices:
            self._within(device, "read", "read")
            self._within(device, "write", "write")
        for phase in ("control", "guard"):
            self._within(cycle, phase, phase)
        for _ in range(5000):
            if lockstep.step() is State.ACTIVE:
                break
        else:
            raise RuntimeError(f"{name} isn't active after 5000 cycles")

    def _within(self, owner: Any, method: str, phase: str) -> None:
        """Counts the time of this method towards the phase."""
        plain, clock, whole = getattr(owner, method), time.thread_time_ns, self._whole

        def timed(*arguments: Any) -> Any:
            self._phase = phase
            started = clock()
            try:
                return plain(*arguments)
            finally:
                whole[phase] += clock() - started
                self._phase = ""

        setattr(owner, method, timed)

    def block(self) -> None:
        """Runs some cycles."""
        for phase in PHASES:
            self._whole[phase] = self._inside[phase] = 0
        with _watched(self):
            for _ in range(BLOCK):
                self._lockstep.step()

    def took(self, parts: dict[str, int]) -> dict[str, float]:
        """Returns us of processor time a cycle by phase."""
        return {phase: parts[phase] / BLOCK / 1e3 for phase in PHASES}


@contextmanager
def _watched(split: _Split) -> Iterator[None]:
    """Meanwhile each of MuJoCo's functions adds its time to the split's present phase."""
    clock, inside = time.thread_time_ns, split._inside

    def watched(plain: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            started = clock()
            found = plain(*arguments)
            if split._phase:
                inside[split._phase] += clock() - started
            return found

        return timed

    plain = {name: getattr(mujoco, name) for name in dir(mujoco) if name.startswith("mj_")}
    for name, function in plain.items():
        setattr(mujoco, name, watched(function))
    try:
        yield
    finally:
        for name, function in plain.items():
            setattr(mujoco, name, function)


def run(id: str, name: str) -> list[Row]:
    """Returns a row for each phase: MuJoCo's calls in it against the whole phase, means of a block's cycles."""
    split = _Split(name)
    gc.collect()

    def inside() -> dict[str, float]:
        split.block()
        return split.took(split._inside)

    pairs = measure(inside, {"the whole phase": lambda: split.took(split._whole)})
    return [
        pairs.row(id, f"{name}, MuJoCo's calls in {phase}, processor time, mean", phase, "the whole phase", "us")
        for phase in PHASES
    ]
