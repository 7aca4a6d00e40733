"""How fast profiles are simulated, next to a bare mj_step loop of the same world.

Two figures a profile. The whole run: `srl run PROFILE --sim --fast`, by the clock on the wall, with its supervisor and
bus beside it. And the cycle alone: the same decisions, fakes and world step by step in one process, by the processor's
time, which other programs on the machine change less. The runs of `moca-man` also give its phases, against its period.
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
from srl.runtime.profile import profile


class Simulated(NamedTuple):
    """How a profile is measured.

    Attributes:
        span: s of simulated time a run.
        pairs: at most.
        aim: least share of the bare loop's speed.
        phases: the id of the rows of a run's phases; "" for none.
    """

    span: float
    pairs: int
    aim: float | None
    phases: str


PROFILES: dict[str, Simulated] = {
    "sixth-finger": Simulated(20.0, PAIRS, 0.4, ""),
    "moca-man": Simulated(3.0, PAIRS // 2, None, "superman-simulated"),
}
_BARE, _PERIOD = "bare mj_step loop", "the period"
_PHASES = ("read", "control", "guard", "write", "log", "whole")


def sixth_finger() -> list[Row]:
    """Compares simulated seconds per second, at 100 Hz."""
    return _run("sixth-finger")


def moca_man() -> list[Row]:
    """Compares simulated seconds per second, at 1 kHz."""
    return _run("moca-man")


def _run(name: str) -> list[Row]:
    span, count, aim, phases = PROFILES[name]
    command = [sys.executable, "-m", "srl", "run", name, "--sim", "--instance", "bench", "--json", "--fast"]
    stepped = [sys.executable, "-m", "bench.simulated", name]

    def ours() -> dict[str, float]:
        run = _summary_of([*command, "--duration", str(span)])
        metrics = {"run": run["realtime_factor"], "cycle": _summary_of([*stepped, "cycle"])["cpu"]}
        return metrics | run["phases_us"] | {"whole": run["cycle_us"]["p50"]}

    def bare() -> dict[str, float]:
        found = _summary_of([*stepped, "bare"])
        return {"run": found["wall"], "cycle": found["cpu"]}

    words = "" if aim is None else f"at least {aim:g}"
    holds = None if aim is None else lambda ratio: ratio >= aim
    period = dict.fromkeys(_PHASES, 1e6 / float(profile.load(name)[0].rate))
    pairs = measure(ours, {_BARE: bare, _PERIOD: lambda: period}, count)
    return [
        pairs.row(f"sim-{name}", f"{name}, simulated speed with --fast", "run", _BARE, "s/s", words, holds),
        pairs.row(f"sim-{name}", f"{name}, its cycle alone, by processor time", "cycle", _BARE, "s/s"),
        *(
            pairs.row(phases, f"{name} --sim --fast, {phase}, p50", phase, _PERIOD, "us")
            for phase in (_PHASES if phases else ())
        ),
    ]


def _summary_of(command: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def _speed(name: str, which: str) -> dict[str, float]:
    """Simulated s per s of the wall's clock and of the processor; only the stepping is timed."""
    import mujoco

    from srl.runtime.loop.lockstep import Lockstep
    from srl.runtime.profile import wiring
    from srl.sim.world.cell import Cell

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
    wall, cpu = time.perf_counter(), time.thread_time()
    for _ in range(steps):
        step()
    return {"wall": span / (time.perf_counter() - wall), "cpu": span / (time.thread_time() - cpu)}


if __name__ == "__main__":
    print(json.dumps(_speed(*sys.argv[1:])))
