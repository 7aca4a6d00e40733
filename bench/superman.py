"""SUPER-MAN: the cost of MOCA's cycle at 1 kHz by phase, and its laws compared with mink and pink on the same task.

MuJoCo's part of each phase is as it was measured (`bench.phases`); a whole run's phases are of the runs of
`sim-moca-man`. The cycle's decisions (control, guard, log) are measured separately, over the rows of a simulated run:
back to back, and once per millisecond, when other programs have used the caches in between.
"""

from __future__ import annotations

import gc
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from bench import differential_ik, phases
from bench.pairs import PAIRS, Pairs, Row, rounds
from srl.runtime.ipc.header import CYCLE, DEVICE, State
from srl.runtime.ipc.ring import RingWriter
from srl.runtime.loop import realtime
from srl.runtime.loop.clock import MonotonicClock
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring

RATE = 1000
SPAN = 1.5  # s per run
BLOCK = 200  # cycles measured one after another
PHASES = ("control", "guard", "log", "whole")
AIMS = {"control": 60.0, "whole": 150.0}  # us
_CYCLE, _NOW, _DT = CYCLE.cycle, CYCLE.now, CYCLE.dt


def run() -> list[Row]:
    """Measures MuJoCo's part of each phase, the decisions alone, and overruns compared with a bare timer's."""
    return [*phases.run("superman-simulated", "moca-man"), *_alone(), *differential_ik.run()]


def _alone() -> list[Row]:
    command = [sys.executable, "-m", "bench.superman"]
    blocks = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    hot = Pairs(blocks["hot"], blocks["hot again"], {"pinocchio's calls": blocks["pinocchio"]})
    paced = Pairs(
        blocks["paced"], blocks["paced again"], {"back to back": blocks["hot"], "bare timer": blocks["timer"]}
    )
    rows = []
    for name in PHASES:
        row = hot.row("superman-decisions", f"{name}, back to back, p50", name, "pinocchio's calls", "us")
        rows.append(_judged(row, name))
    for name in PHASES:
        row = paced.row("superman-paced", f"{name}, once a millisecond, p50", name, "back to back", "us")
        rows.append(_judged(row, name))
    what = "1 + periods missed of 1000 at real-time priority"
    rows.append(paced.row("superman-paced", what, "missed", "bare timer", "1"))
    return rows


def _judged(row: Row, name: str) -> Row:
    aim = AIMS.get(name)
    return row if aim is None else replace(row, aim=f"under {aim:g} us", holds=row.ours < aim)


class Decisions:
    """Runs check, control, guard and log of a profile over the rows of its own simulated run."""

    def __init__(self, name: str, overrides: Sequence[str] = (), span: float = SPAN) -> None:
        """overrides: of the profile; span: s of simulated time."""
        checked, source = profile.load(name, overrides)
        graph = wiring.build(checked, source, [])
        assert graph.world is not None
        self._graph, self._made = graph, graph.row
        self._lockstep = lockstep = Lockstep(graph)
        self._step = lockstep.cycle
        rows = []
        for _ in range(round(span * 1e9 / lockstep.period)):
            lockstep.sense()
            before = graph.row.words.copy()
            if lockstep.act() is State.ACTIVE and lockstep.count > 100:
                rows.append(before)
        self._rows, self._at = rows, 0
        # Time goes on from lap to lap: the watch of the base's pose takes a clock that goes back for a jump.
        self._lap = self._ahead = lockstep.count * lockstep.period
        self._stamps = graph.row.devices[:, DEVICE.stamp]
        self._folder = tempfile.TemporaryDirectory()
        self._ring = RingWriter.create(Path(self._folder.name) / "rows", graph.layout.width, 4096)

    def __enter__(self) -> Decisions:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def cycles(self, count: int, each: Callable[[], None] = lambda: None) -> dict[str, float]:
        """Returns the us of each phase, p50 of `count` cycles; `each` is called before every cycle."""
        took = np.zeros((count, 4))
        step, words, clock = self._step, self._made.words, time.perf_counter_ns
        for i in range(count):
            each()
            self._at = (self._at + 1) % len(self._rows)
            self._ahead += self._lap * (self._at == 0)
            words[:] = self._rows[self._at]
            self._made.ints[_NOW] += self._ahead
            self._stamps += self._ahead
            started = clock()
            step.check(0)
            step.control()
            controlled = clock()
            step.guard()
            guarded = clock()
            self._ring.append(words)
            logged = clock()
            took[i] = controlled - started, guarded - controlled, logged - guarded, logged - started
        assert step.machine.state is State.ACTIVE
        return dict(zip(PHASES, (np.median(took, axis=0) / 1e3).tolist(), strict=True))

    def pinocchio(self) -> dict[str, float]:
        """Returns the us of only the rigid-body calls that MOCA's laws make; all of them belong to control."""
        import pinocchio as pin

        from srl.control.cobot.whole_body import BASE, ArmDynamics, WholeBody
        from srl.runtime.models.robots import PANDA

        body, arm = WholeBody(PANDA, np.eye(4), np.eye(4)), ArmDynamics(PANDA)
        q, qd = np.zeros(BASE + PANDA.n), np.full(PANDA.n, 0.1)
        q[BASE:] = PANDA.home
        took = []
        for _ in range(BLOCK):
            started = time.perf_counter_ns()
            pin.computeFrameJacobian(body._model, body._data, q, body._frame, pin.LOCAL_WORLD_ALIGNED)
            pin.updateFramePlacement(body._model, body._data, body._frame)
            arm.inverse_mass(q[BASE:])
            arm.bias(q[BASE:], qd, gravity=False, coriolis=True)
            took.append(time.perf_counter_ns() - started)
        return dict.fromkeys(PHASES, statistics.median(took) / 1e3)


def _blocks() -> dict[str, list[dict[str, float]]]:
    """Returns figures of interleaved blocks, measured in their own process at real-time priority."""
    found: dict[str, list[dict[str, float]]] = {
        name: [] for name in ("hot", "pinocchio", "hot again", "timer", "paced", "paced again")
    }
    with Decisions("moca-man") as decisions:
        gc.collect()
        realtime.enter()

        def paced(cycles: Callable[[Callable[[], None]], dict[str, float]]) -> dict[str, float]:
            clock, missed = MonotonicClock(Fraction(RATE)), 0

            def wait() -> None:
                nonlocal missed
                missed += clock.wait().missed

            clock.start()
            metrics = cycles(wait)
            return metrics | {"missed": 1 + 1000 * missed / BLOCK}

        def timer(wait: Callable[[], None]) -> dict[str, float]:
            for _ in range(BLOCK):
                wait()
            return {}

        for _ in rounds(PAIRS):
            found["hot"].append(decisions.cycles(BLOCK))
            found["pinocchio"].append(decisions.pinocchio())
            found["hot again"].append(decisions.cycles(BLOCK))
            found["timer"].append(paced(timer))
            found["paced"].append(paced(lambda wait: decisions.cycles(BLOCK, wait)))
            found["paced again"].append(paced(lambda wait: decisions.cycles(BLOCK, wait)))
    return found


if __name__ == "__main__":
    print(json.dumps(_blocks()))
