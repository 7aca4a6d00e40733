"""How fast profiles are simulated, next to a bare mj_step loop of the same world.

Two figures a profile. The whole run: `srl run PROFILE --sim --fast`, by the clock on the wall, with its supervisor and
bus beside it. And the cycle alone: the same decisions, fakes and world step by step in one process, by the processor's
time, which other programs on the machine change less.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

from bench.pairs import PAIRS, Row, measure


class Simulated(NamedTuple):
    """How a profile is measured. `span`: s of simulated time a run; `aim`: least share of the bare loop's speed."""

    span: float
    pairs: int
    aim: float | None


PROFILES: dict[str, Simulated] = {
    "sixth-finger": Simulated(20.0, PAIRS, 0.4),
    "moca-man": Simulated(3.0, PAIRS // 2, None),
}
_BARE = "bare mj_step loop"


def sixth_finger() -> list[Row]:
    """Compares simulated seconds per second, at 100 Hz."""
    return _run("sixth-finger")


def moca_man() -> list[Row]:
    """Compares simulated seconds per second, at 1 kHz."""
    return _run("moca-man")


def _run(name: str) -> list[Row]:
    span, count, aim = PROFILES[name]
    command = [sys.executable, "-m", "runtime", "run", name, "--sim", "--instance", "bench", "--json", "--fast"]

    def whole() -> dict[str, float]:
        return {"speed": _said([*command, "--duration", str(span)])["realtime_factor"]}

    def alone(which: str) -> dict[str, float]:
        return _said([sys.executable, "-m", "bench.simulated", name, which])

    words = "" if aim is None else f"at least {aim:g}"
    holds = None if aim is None else lambda ratio: ratio >= aim
    runs = measure(whole, {_BARE: lambda: alone("bare")}, count)
    cycles = measure(lambda: alone("cycle"), {_BARE: lambda: alone("bare, by the processor")}, count)
    return [
        runs.row(f"sim-{name}", f"{name}, simulated speed with --fast", "speed", _BARE, "s/s", words, holds),
        cycles.row(f"sim-{name}", f"{name}, its cycle alone, by processor time", "speed", _BARE, "s/s"),
    ]


def _said(command: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def _speed(name: str, which: str) -> float:
    """Simulated s per s; only the stepping is timed."""
    import mujoco

    from runtime.loop.lockstep import Lockstep
    from runtime.profile import profile, wiring
    from sim.world.cell import Cell

    checked, source = profile.load(name)
    graph = wiring.build(checked, source, [])
    span, world = PROFILES[name].span, cast(Cell, graph.world)
    step: Callable[[], object]
    if which == "cycle":
        lockstep = Lockstep(graph)
        steps, step = round(span * 1e9 / lockstep.period), lockstep.step
    else:
        world.advance(10_000_000)
        steps, step = round(span / world.model.opt.timestep), partial(mujoco.mj_step, world.model, world.data)
    clock = time.perf_counter if which == "bare" else time.thread_time
    begun = clock()
    for _ in range(steps):
        step()
    return span / (clock() - begun)


if __name__ == "__main__":
    print(json.dumps({"speed": _speed(*sys.argv[1:])}))
